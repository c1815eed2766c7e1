//! The simulated machine and its instruments: kinematics, surveys, what the product identifies from them.

mod against_model;
mod default_machine;
mod machine;
mod measure_ballbar;
mod measure_lasers;
mod measure_probes;
mod measure_tracker;
#[path = "../../../tests/numbers/random_machine.rs"]
mod random_machine;
mod serve_lasers;
mod survey;
mod vectors;
