//! A progress bar for work that takes long.

use std::cell::OnceCell;
use std::path::Path;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// The bar of a file appears after this time.
const SLOW: Duration = Duration::from_secs(2);
/// Time after which a search counts as slow.
const SEARCH_SLOW: Duration = Duration::from_secs(1);
/// What stands in the bar of a file.
const OF_BYTES: &str = "{bar:40} {bytes}/{total_bytes} {bytes_per_sec} {eta}";

/// A bar on stderr, only where that is a terminal and the work takes long.
pub(super) struct Progress {
    started: Instant,
    slow: Duration,
    style: Option<ProgressStyle>,
    /// Size of the file, where it is known.
    total: Option<u64>,
    bar: OnceCell<ProgressBar>,
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.finish();
    }
}

impl Progress {
    #[expect(clippy::disallowed_methods, reason = "the bar appears only where the work takes long")]
    fn new(slow: Duration, style: Option<ProgressStyle>, total: Option<u64>) -> Self {
        Self { started: Instant::now(), slow, style, total, bar: OnceCell::new() }
    }

    /// For work on this file from now on.
    #[expect(clippy::disallowed_methods, reason = "the size of the file is the length of the bar")]
    pub(super) fn of_file(file: &Path) -> Self {
        let total = std::fs::metadata(file).ok().filter(std::fs::Metadata::is_file).map(|m| m.len());
        Self::new(SLOW, ProgressStyle::with_template(OF_BYTES).ok(), total)
    }

    /// For a search of so many steps as [`Self::show`] says.
    pub(super) fn of_steps() -> Self {
        Self::new(SEARCH_SLOW, None, None)
    }

    /// So many bytes are done.
    pub(super) fn update(&self, bytes: u64) {
        self.show_of(bytes, self.total);
    }

    /// So many steps are done.
    pub(super) fn show(&self, done: u64, of: u64) {
        self.show_of(done, Some(of));
    }

    fn show_of(&self, done: u64, of: Option<u64>) {
        if self.started.elapsed() < self.slow {
            return;
        }
        let begin = || {
            let bar = of.map_or_else(ProgressBar::no_length, ProgressBar::new);
            self.style.iter().for_each(|style| bar.set_style(style.clone()));
            bar
        };
        self.bar.get_or_init(begin).set_position(done);
    }

    /// Takes the bar away.
    pub(super) fn finish(&self) {
        self.bar.get().into_iter().for_each(ProgressBar::finish_and_clear);
    }
}
