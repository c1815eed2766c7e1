//! Every change of state that the engine can make, and why. `docs/explanation/safety.md` shows the same rules to people; tests hold
//! code, rules and page together.

use super::output::{Reason, State};
use volcomp_protocol::CorrectionState::{
    Active, Armed, FadingToStatic, Faulted, Holding, Off, RampingIn, RampingOut,
};

/// What makes the engine change its state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// Something that the engine found out in a cycle; it tells an event.
    Reason(Reason),
    /// A command, at once: whoever gives it knows.
    Command,
    /// The link came or went: the link's own message tells.
    Link,
}

/// Changes of state with the same reaction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rule {
    /// The states left.
    pub from: &'static [State],
    /// The state entered.
    pub to: State,
    /// Why, each of them from each of these states.
    pub causes: &'static [Cause],
    /// What happens to the offset.
    pub reaction: &'static str,
}

use Cause::Reason as By;

/// Positions that cannot be used.
const BAD_DATA: &[Cause] = &[
    By(Reason::Stale),
    By(Reason::NotFinite),
    By(Reason::Jump),
    By(Reason::ControlClock),
    By(Reason::Frozen),
    By(Reason::ModelNotFinite),
];
/// Told to end, or nothing measured here.
const UNWANTED: &[Cause] = &[By(Reason::Command), By(Reason::OutOfTravel)];

/// All of them.
pub const RULES: &[Rule] = &[
    Rule { from: &[Off], to: Armed, causes: &[Cause::Command], reaction: "none; waits for machine and data" },
    Rule { from: &[Armed], to: Off, causes: &[By(Reason::Command), Cause::Link], reaction: "none" },
    Rule {
        from: &[Armed],
        to: RampingIn,
        causes: &[By(Reason::MachineReady)],
        reaction: "blended from the offset in the control to the correction over ramp-s",
    },
    Rule {
        from: &[Off, Armed],
        to: RampingOut,
        causes: &[
            By(Reason::FoundOffset),
            By(Reason::Stale),
            By(Reason::NotFinite),
            By(Reason::Jump),
            By(Reason::ControlClock),
            By(Reason::Frozen),
            By(Reason::ModelNotFinite),
        ],
        reaction: "a foreign offset is blended to zero; with bad data after hold-s",
    },
    Rule {
        from: &[RampingIn],
        to: Active,
        causes: &[By(Reason::RampDone)],
        reaction: "follows the correction",
    },
    Rule {
        from: &[Active, FadingToStatic],
        to: RampingIn,
        causes: &[By(Reason::ToolChanged), By(Reason::ModelChanged)],
        reaction: "blended from the old correction to the new one over ramp-s",
    },
    Rule {
        from: &[Active],
        to: FadingToStatic,
        causes: &[By(Reason::LiveLost)],
        reaction: "the silent sensor's part is ramped out over ramp-s, the static model continues",
    },
    Rule {
        from: &[FadingToStatic],
        to: Active,
        causes: &[By(Reason::RampDone)],
        reaction: "follows the static correction, or the sensor is back",
    },
    Rule {
        from: &[RampingIn, Active, FadingToStatic],
        to: RampingOut,
        causes: UNWANTED,
        reaction: "blended to zero over ramp-s",
    },
    Rule {
        from: &[RampingIn, Active, FadingToStatic],
        to: Holding,
        causes: UNWANTED,
        reaction: "a stop with rest = \"hold\": braked to rest and kept",
    },
    Rule {
        from: &[RampingIn, Active, FadingToStatic],
        to: Holding,
        causes: BAD_DATA,
        reaction: "braked to rest and held, for hold-s at most",
    },
    Rule {
        from: &[RampingIn, Active, FadingToStatic, RampingOut],
        to: Holding,
        causes: &[By(Reason::NotHomed), By(Reason::NotEnabled), By(Reason::EmergencyStop)],
        reaction: "not moved for as long as it lasts",
    },
    Rule {
        from: &[RampingIn, Active, FadingToStatic, RampingOut],
        to: Holding,
        causes: &[By(Reason::ControlTookOver)],
        reaction: "continues, at rest, from the offset in the control; beyond one step on a new link",
    },
    Rule {
        from: &[Holding],
        to: RampingIn,
        causes: &[By(Reason::DataGood)],
        reaction: "blended from the held offset to the correction over ramp-s",
    },
    Rule {
        from: &[Holding],
        to: RampingOut,
        causes: &[
            By(Reason::Stale),
            By(Reason::NotFinite),
            By(Reason::Jump),
            By(Reason::ControlClock),
            By(Reason::Frozen),
            By(Reason::ModelNotFinite),
            By(Reason::Command),
            By(Reason::OutOfTravel),
        ],
        reaction: "blended to zero over ramp-s; with bad data after hold-s",
    },
    Rule {
        from: &[Holding],
        to: Off,
        causes: &[By(Reason::Command)],
        reaction: "a stop with rest = \"hold\": stays where it is",
    },
    Rule {
        from: &[RampingOut],
        to: RampingIn,
        causes: &[By(Reason::Command), By(Reason::DataGood)],
        reaction: "turned round: blended from the present offset to the correction over ramp-s",
    },
    Rule { from: &[RampingOut], to: Off, causes: &[By(Reason::RampDone)], reaction: "zero" },
    Rule {
        from: &[RampingOut],
        to: Armed,
        causes: &[By(Reason::RampDone)],
        reaction: "zero; waits for machine and data",
    },
    Rule {
        from: &[RampingIn, Active, FadingToStatic],
        to: Faulted,
        causes: &[By(Reason::StopLimit)],
        reaction: "blended to zero over ramp-s and latched there",
    },
    Rule {
        from: &[Off, Armed, RampingIn, Active, FadingToStatic, Holding, RampingOut],
        to: Faulted,
        causes: &[By(Reason::ReadBack), By(Reason::ImplausibleOffset)],
        reaction: "latched; no further correction is sent: the control removes its offset by its own rule",
    },
    Rule {
        from: &[RampingOut],
        to: Faulted,
        causes: &[By(Reason::DataLost)],
        reaction: "at zero after bad data, and latched there (after-loss = \"latch\")",
    },
    Rule {
        from: &[Off, Armed],
        to: Faulted,
        causes: &[Cause::Link],
        reaction: "the control has come back with another hello: the fault of before stays, and nothing is sent",
    },
    Rule {
        from: &[Faulted],
        to: Off,
        causes: &[Cause::Command],
        reaction: "none; a fault is cleared only with the link up, where the control reports no offset",
    },
    Rule {
        from: &[RampingIn, Active, FadingToStatic, Holding, RampingOut],
        to: Armed,
        causes: &[Cause::Link],
        reaction: "nothing can be sent: the control holds, then ramps out by itself; the next link goes on from there",
    },
    Rule {
        from: &[RampingIn, Active, FadingToStatic, Holding, RampingOut],
        to: Off,
        causes: &[Cause::Link],
        reaction: "the same; an offset found on the next link is blended to zero",
    },
];

/// Every single change of state.
pub fn all() -> impl Iterator<Item = (State, State, Cause)> {
    RULES.iter().flat_map(|rule| {
        rule.from.iter().flat_map(move |from| rule.causes.iter().map(move |cause| (*from, rule.to, *cause)))
    })
}
