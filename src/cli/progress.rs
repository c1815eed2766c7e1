//! A progress bar for work that reads a file.

use std::cell::OnceCell;
use std::io::{self, IsTerminal};
use std::path::Path;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// The bar appears after this time.
const SLOW: Duration = Duration::from_secs(2);
/// Time after which a search counts as slow.
const SEARCH_SLOW: Duration = Duration::from_secs(1);

/// A bar on stderr, only where that is a terminal and the work takes long.
pub(super) struct Progress {
    started: Instant,
    total: Option<u64>,
    shown: bool,
    bar: Option<ProgressBar>,
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.finish();
    }
}

impl Progress {
    /// For work on this file from now on.
    #[expect(clippy::disallowed_methods, reason = "the bar appears only where the work takes long")]
    pub(super) fn new(points: &Path) -> Self {
        let total = std::fs::metadata(points).ok().filter(std::fs::Metadata::is_file).map(|m| m.len());
        Self { started: Instant::now(), total, shown: io::stderr().is_terminal(), bar: None }
    }

    /// So many bytes are done.
    pub(super) fn update(&mut self, bytes: u64) {
        if !self.shown || self.started.elapsed() < SLOW {
            return;
        }
        let bar = self.bar.get_or_insert_with(|| {
            let bar = ProgressBar::with_draw_target(self.total, ProgressDrawTarget::stderr());
            let template = "{bar:40} {bytes}/{total_bytes} {bytes_per_sec} {eta}";
            if let Ok(style) = ProgressStyle::with_template(template) {
                bar.set_style(style);
            }
            bar
        });
        bar.set_position(bytes);
    }

    /// Takes the bar away.
    pub(super) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// A progress bar on the terminal that appears only where the search takes longer than a second.
pub(super) struct Steps {
    start: Instant,
    bar: OnceCell<ProgressBar>,
}

impl Steps {
    #[expect(clippy::disallowed_methods, reason = "the bar appears only where the work takes long")]
    pub(super) fn new() -> Self {
        Self { start: Instant::now(), bar: OnceCell::new() }
    }

    pub(super) fn show(&self, done: u64, of: u64) {
        if self.start.elapsed() > SEARCH_SLOW {
            self.bar.get_or_init(|| ProgressBar::new(of)).set_position(done);
        }
    }

    pub(super) fn clear(&self) {
        if let Some(bar) = self.bar.get() {
            bar.finish_and_clear();
        }
    }
}
