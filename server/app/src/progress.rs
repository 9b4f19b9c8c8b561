//! Progress bar on a terminal, silence in a pipe.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use surfelcast_renderer::JobProgress;

/// Steps of the bar.
const STEPS: u64 = 1000;

/// Shows how far a render is.
#[derive(Debug)]
pub(crate) struct Progress {
    bar: ProgressBar,
}

impl Progress {
    pub(crate) fn new() -> Self {
        let bar = ProgressBar::new(STEPS);
        if !std::io::stderr().is_terminal() {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        if let Ok(style) = ProgressStyle::with_template("{bar:40} {percent:>3} %  {msg}  {elapsed}") {
            bar.set_style(style);
        }
        Self { bar }
    }

    /// Says what is being done before rendering begins.
    pub(crate) fn say(&self, message: &'static str) {
        self.bar.set_message(message);
    }

    pub(crate) fn show(&self, progress: &JobProgress) {
        self.bar.set_position((f64::from(progress.fraction) * STEPS as f64) as u64);
        self.bar.set_message(match progress.error {
            Some(error) => format!("{} samples, RMSE {:.4}", progress.samples, error.rmse_tonemapped),
            None => format!("{} samples", progress.samples),
        });
    }

    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
