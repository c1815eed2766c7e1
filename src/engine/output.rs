//! What the engine says after each cycle.

use volcomp_model::axes::AxisArray;
use volcomp_protocol::CorrectionState;

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
    /// The engine before this one was faulted: so is this one, until somebody has looked.
    KeepFault,
}

/// Why a state was entered, with its number in the catalogue of faults.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reason {
    /// A command.
    Command = 1001,
    /// The machine became ready (homed, enabled, no emergency stop).
    MachineReady = 1002,
    /// The machine is not homed.
    NotHomed = 2001,
    /// The drives are off.
    NotEnabled = 2002,
    /// Emergency stop.
    EmergencyStop = 2003,
    /// A ramp has ended.
    RampDone = 1003,
    /// No fresh position.
    Stale = 3001,
    /// A position was NaN or infinite.
    NotFinite = 3002,
    /// A position jumped further than is plausible.
    Jump = 3003,
    /// Frames out of order or repeated.
    Sequence = 3004,
    /// The control's clock went backwards or jumped.
    ControlClock = 3005,
    /// An axis is outside the travel of the model.
    OutOfTravel = 3007,
    /// Fresh, plausible data again.
    DataGood = 1004,
    /// The offset read back is not the one that was sent.
    ReadBack = 4001,
    /// The control reports an offset that it cannot have been sent: beyond the limits, or beyond twice the limits on a
    /// new link.
    ImplausibleOffset = 4007,
    /// The control holds an offset that was left by somebody else.
    FoundOffset = 4002,
    /// The control has been taking the offset back by itself.
    ControlTookOver = 4003,
    /// The control says that it moves, but its positions do not change.
    Frozen = 3006,
    /// The correction asked for is beyond the stop limit of an axis.
    StopLimit = 4004,
    /// The model gave something that is not a number.
    ModelNotFinite = 5001,
    /// Another model.
    ModelChanged = 1005,
    /// Another tool.
    ToolChanged = 1006,
    /// A sensor whose live value is in use has fallen silent.
    LiveLost = 8001,
    /// Positions stayed away, or could not be used, until the offset was back at zero.
    DataLost = 3008,
}

impl Reason {
    /// Every reason.
    pub const ALL: [Self; 24] = [
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
        Self::ImplausibleOffset,
        Self::FoundOffset,
        Self::ControlTookOver,
        Self::Frozen,
        Self::StopLimit,
        Self::ModelNotFinite,
        Self::ModelChanged,
        Self::ToolChanged,
        Self::LiveLost,
        Self::DataLost,
    ];

    /// True where a change of state for this reason tells the numbers behind it ([`Detail`]).
    #[must_use]
    pub const fn has_numbers(self) -> bool {
        matches!(
            self,
            Self::Stale
                | Self::NotFinite
                | Self::Jump
                | Self::ControlClock
                | Self::Frozen
                | Self::OutOfTravel
                | Self::ReadBack
                | Self::ImplausibleOffset
                | Self::StopLimit
                | Self::ModelNotFinite
                | Self::DataLost
        )
    }
}

/// What a number of [`Detail`] is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Of an axis: mm, or deg of a rotary one.
    Axis,
    /// mm.
    Length,
    /// s.
    Time,
}

/// The numbers behind a change of state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detail {
    /// Wire index of the axis, where it is about one.
    pub axis: Option<u8>,
    /// In what the two others are.
    pub quantity: Quantity,
    /// What was found.
    pub value: f64,
    /// What it must not exceed; NaN where there is no limit to compare with.
    pub limit: f64,
}

impl Detail {
    /// About axis `axis`: mm or deg.
    pub(super) const fn of_axis(axis: usize, value: f64, limit: f64) -> Self {
        Self { axis: Some(axis as u8), quantity: Quantity::Axis, value, limit }
    }

    /// A time, s.
    pub(super) const fn of_time(value: f64, limit: f64) -> Self {
        Self { axis: None, quantity: Quantity::Time, value, limit }
    }
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
        /// The numbers behind it, where there are any.
        detail: Option<Detail>,
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
    /// Bit k: axis k is outside the travel of the model, and the offset follows the correction all the same.
    pub out_of_travel: u8,
    /// Bit k: the offset of axis k has stayed away from the correction for longer than its limits explain.
    pub lagging: u8,
    /// Bit k: harmonics of axis k have faded, for at this feed they could not be placed right.
    pub faded: u8,
    /// Correction asked for by the model, times the gain, before ramps and limits; mm or rad.
    pub wanted: AxisArray,
    /// The same without the gain and what soft limits take off.
    pub known: AxisArray,
    /// Control cycles from a position to the effect of its correction, where they could be measured.
    pub lag_cycles: Option<u32>,
    /// What happened, at most one thing a cycle.
    pub event: Option<Event>,
    /// True once a [`Command::Stop`] has been carried out: nothing more will change.
    pub stopped: bool,
}
