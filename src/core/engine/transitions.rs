//! Every change of state that the engine can make, and why. `docs/safety.md` shows the same table to people; tests hold
//! code, table and page together.

use super::output::{Reason, State};

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

/// A change of state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Transition {
    /// The state left.
    pub from: State,
    /// The state entered.
    pub to: State,
    /// Why.
    pub cause: Cause,
}

/// All of them.
pub const TRANSITIONS: &[Transition] = &[];
