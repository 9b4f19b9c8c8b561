//! How long the renderer goes on with its device: how often it tries to open it, and after how many losses it gives up.

use std::collections::VecDeque;
use std::fmt::Display;
use std::time::{Duration, Instant};

use surfelcast_gpu::{Gpu, GpuOptions};
use surfelcast_passes::features::general_features;
use surfelcast_techniques::MaterialMode;

use crate::config::RendererConfig;

/// Losses within [`LOSS_WINDOW`] after which the device is given up.
const MAX_LOSSES: usize = 3;
const LOSS_WINDOW: Duration = Duration::from_mins(5);
/// Waits before each attempt to open the device.
const OPEN_WAITS: [Duration; 3] = [Duration::ZERO, Duration::from_millis(500), Duration::from_secs(2)];

/// What follows a loss.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AfterLoss {
    /// Open a device again.
    Reopen,
    /// Work no more: a driver that fails this often needs a person.
    GiveUp,
}

/// Losses of the last [`LOSS_WINDOW`].
#[derive(Debug, Default)]
pub(crate) struct LossLog {
    losses: VecDeque<Instant>,
}

impl LossLog {
    /// Records a loss and decides what follows.
    pub(crate) fn record(&mut self, now: Instant) -> AfterLoss {
        self.losses.retain(|at| now.duration_since(*at) < LOSS_WINDOW);
        self.losses.push_back(now);
        if self.losses.len() >= MAX_LOSSES { AfterLoss::GiveUp } else { AfterLoss::Reopen }
    }
}

/// Opens the device that the configuration names, in as many attempts as [`OPEN_WAITS`] has; `None` after the last.
pub(crate) fn open(config: &RendererConfig) -> Option<Gpu> {
    let options = GpuOptions {
        adapter: config.adapter.clone(),
        cache_dir: config.cache_dir.clone(),
        memory_budget_bytes: config.memory_budget_bytes,
        allow_forced_loss: config.allow_forced_loss,
        ..GpuOptions::default()
    };
    let gpu = attempt(|| Gpu::open(&options), std::thread::sleep)?;
    if config.prepares_general_kernels && !gpu.compiles_when_run() {
        // They compile while the first scene is still being read.
        let techniques = config.techniques.iter().flat_map(|entry| (entry.kernels)(&entry.description.defaults()));
        for kernel in techniques.chain(["error_audit"]) {
            gpu.prepare(kernel, general_features(MaterialMode::Pbr, false));
        }
    }
    Some(gpu)
}

/// The first success, after waits that grow.
fn attempt<T, E: Display>(mut open: impl FnMut() -> Result<T, E>, mut wait: impl FnMut(Duration)) -> Option<T> {
    OPEN_WAITS.iter().find_map(|&pause| {
        wait(pause);
        open().inspect_err(|error| tracing::error!(%error, "the render device could not be opened")).ok()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_losses_in_five_minutes_are_too_many() {
        let start = Instant::now();
        let at = |secs| start + Duration::from_secs(secs);
        let mut log = LossLog::default();
        assert_eq!(log.record(at(0)), AfterLoss::Reopen);
        assert_eq!(log.record(at(200)), AfterLoss::Reopen);
        assert_eq!(log.record(at(299)), AfterLoss::GiveUp);
    }

    #[test]
    fn losses_of_long_ago_are_forgiven() {
        let start = Instant::now();
        let mut log = LossLog::default();
        for loss in 0..10 {
            assert_eq!(log.record(start + Duration::from_secs(150 * loss)), AfterLoss::Reopen, "loss {loss}");
        }
    }

    #[test]
    fn opening_is_tried_three_times_with_growing_waits() {
        let mut waits = Vec::new();
        assert_eq!(attempt(|| Err::<(), _>("no driver"), |pause| waits.push(pause)), None);
        assert_eq!(waits, OPEN_WAITS);
        assert!(waits[0] == Duration::ZERO && waits.is_sorted());

        let mut answers = [Err("busy"), Ok(7)].into_iter();
        assert_eq!(attempt(|| answers.next().unwrap(), |_| ()), Some(7));
    }
}
