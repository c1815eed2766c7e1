//! Live estimation: readings of sensors in, live values for the engine out.
//!
//! Pure: time is an argument, readings and positions are handed in, what the cycle evaluates is handed out as a
//! [`LiveTable`]. The daemon's estimator thread, the tests and the Monte Carlo runs use this same code.
//!
//! What a sensor says is compared with what the static model expects where the machine stood when the reading was
//! taken; the difference belongs to a map ([`MapSpec`]: the ram), to an axis (5-DOF laser) or is itself the value. How
//! a live value of the model acts on a reading is asked of the model, so that this holds for any chain.
//!
//! Reading order: [`spec`] (what there is), [`reading`] (what sensors say), [`history`] (where the machine stood),
//! [`rows`] (what a reading says about a map), [`axis`] (5-DOF lasers), [`thermal_displacement`] (heat), [`sensor`]
//! and [`map`] (their states), `sensor_probation` (what a sensor has proven), [`estimator`] (all together), [`table`]
//! (what the cycle evaluates), [`health`] (how it goes, as data).

pub mod axis;
pub mod estimator;
pub mod health;
pub mod history;
pub mod map;
pub mod reading;
pub mod rows;
pub mod sensor;
mod sensor_probation;
pub mod spec;
pub mod table;
pub mod thermal_displacement;

pub use axis::LaserAlignment;
pub use estimator::{LiveEstimator, LiveModel, MapCondition};
pub use health::{LiveHealth, MapHealth, NodeHealth, SensorHealth, ThermalHealth};
pub use history::{MotionHistory, MotionSample};
pub use map::SavedMap;
pub use reading::{Body, PointReading, Reading, Seen, ToolReading};
pub use spec::{LiveError, LiveSpec, MapSpec, SensorKind, SensorSpec};
pub use table::{LiveEvaluator, LiveTable};
pub use thermal_displacement::{SavedThermalState, ThermalStatus};
