//! What the engine says after each cycle.

use crate::core::axes::AxisArray;
use crate::core::protocol::CorrectionState;

/// State of the engine; the same values go to the control with every correction.
pub type State = CorrectionState;

/// What the operator or the service asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Compensate as soon as the machine is ready.
    Enable,
    /// Ramp out and stay off.
    Disable,
    /// Change the share of the correction, 0 to 1; ramped.
    SetGain(f64),
    /// Ramp to the rest offset and then be done: the process is about to stop.
    Stop,
    /// Leave the faulted state (the cause must be gone); stays off until enabled.
    ClearFault,
}

/// Why a state was entered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reason {
    /// A command.
    Command,
    /// The machine became ready (homed, enabled, no emergency stop).
    MachineReady,
    /// The machine is not homed.
    NotHomed,
    /// The drives are off.
    NotEnabled,
    /// Emergency stop.
    EmergencyStop,
    /// A ramp has ended.
    RampDone,
    /// No fresh position.
    Stale,
    /// A position was NaN or infinite.
    NotFinite,
    /// A position jumped further than is plausible.
    Jump,
    /// Frames out of order or repeated.
    Sequence,
    /// The control's clock went backwards or jumped.
    ControlClock,
    /// An axis is outside the travel of the model.
    OutOfTravel,
    /// Fresh, plausible data again.
    DataGood,
    /// The offset read back is not the one that was sent.
    ReadBack,
    /// The control holds an offset that was left by somebody else.
    FoundOffset,
    /// The control has been taking the offset back by itself.
    ControlTookOver,
    /// The control says that it moves, but its positions do not change.
    Frozen,
    /// The correction asked for is beyond the stop limit of an axis.
    StopLimit,
    /// The model gave something that is no number.
    ModelNotFinite,
    /// Another model.
    ModelChanged,
    /// Another tool.
    ToolChanged,
    /// A sensor whose live value is in use has fallen silent.
    LiveLost,
}

impl Reason {
    /// Every reason.
    pub const ALL: [Self; 22] = [
        Self::Command,
        Self::MachineReady,
        Self::NotHomed,
        Self::NotEnabled,
        Self::EmergencyStop,
        Self::RampDone,
        Self::Stale,
        Self::NotFinite,
        Self::Jump,
        Self::Sequence,
        Self::ControlClock,
        Self::OutOfTravel,
        Self::DataGood,
        Self::ReadBack,
        Self::FoundOffset,
        Self::ControlTookOver,
        Self::Frozen,
        Self::StopLimit,
        Self::ModelNotFinite,
        Self::ModelChanged,
        Self::ToolChanged,
        Self::LiveLost,
    ];
}

/// Something that happened in this cycle and belongs into the log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event {
    /// The state changed.
    StateChanged {
        /// The state left.
        from: State,
        /// The state entered.
        to: State,
        /// Why.
        reason: Reason,
    },
}

/// The result of one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CycleOutput {
    /// The frame that is answered.
    pub sequence: u32,
    /// State after this cycle.
    pub state: State,
    /// Offset per axis in wire order, mm or rad.
    pub offset: AxisArray,
    /// Bit k: axis k is limited in size, rate or acceleration.
    pub limited: u8,
    /// Bit k: of these, axis k is limited by a soft limit of the machine.
    pub at_soft_limit: u8,
    /// Bit k: axis k is above its warning limit.
    pub warning: u8,
    /// The frame was old or repeated: it says nothing new, and was not used.
    pub out_of_order: bool,
    /// Bit k: axis k is outside the travel or a curve's range of the model.
    pub out_of_range: u8,
    /// Bit k: harmonics of axis k have faded, for at this feed they could not be placed right.
    pub faded: u8,
    /// Correction asked for by the model, times the gain, before ramps and limits; mm or rad.
    pub wanted: AxisArray,
    /// Control cycles from a position to the effect of its correction, where they could be measured.
    pub lag_cycles: Option<u32>,
    /// What happened, at most one thing a cycle.
    pub event: Option<Event>,
    /// True once a [`Command::Stop`] has been carried out: nothing more will change.
    pub stopped: bool,
}
