//! Colour, on a terminal only.

use std::io::IsTerminal;

/// Whether text is coloured.
#[derive(Debug, Clone, Copy)]
pub(super) struct Paint {
    on: bool,
}

impl Paint {
    /// Colour where stdout is a terminal that has it and `NO_COLOR` (no-color.org) is not set.
    #[expect(
        clippy::disallowed_methods,
        reason = "whether stdout is a terminal, and what the user has set for it"
    )]
    pub(super) fn of_stdout() -> Self {
        let set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
        let dumb = std::env::var_os("TERM").is_some_and(|value| value == "dumb");
        Self { on: std::io::stdout().is_terminal() && !set("NO_COLOR") && !dumb }
    }

    /// All is well.
    pub(super) fn green(self, text: &str) -> String {
        self.with("32", text)
    }

    /// Attention.
    pub(super) fn yellow(self, text: &str) -> String {
        self.with("33", text)
    }

    /// A fault.
    pub(super) fn red(self, text: &str) -> String {
        self.with("1;31", text)
    }

    fn with(self, colour: &str, text: &str) -> String {
        if self.on { format!("\x1b[{colour}m{text}\x1b[0m") } else { text.to_owned() }
    }
}
