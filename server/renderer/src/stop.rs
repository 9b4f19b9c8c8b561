//! When a job is done.
//!
//! No device in it: samples, elapsed time and audited errors are handed in.

use std::time::Duration;

use crate::progressive::{MAX_JOB_BATCH, Until};
use surfelcast_render_api::StopRules;

/// Samples a pixel after which a job without another rule ends.
const MAX_SAMPLES: u32 = 1 << 20;
/// Samples from which a biased technique may be stopped as stalled ...
const STALL_SAMPLES: u32 = 512;
/// ... and the share of the error at a quarter of the samples above which it is: noise alone would leave a half.
const STALL_SHARE: f64 = 0.85;
/// Largest batch under a time limit, which may cut a batch short and leave the image uneven.
const MAX_TIMED_BATCH: u32 = 4;

/// Why a job ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StopReason {
    Samples,
    MaxError,
    TimeLimit,
    Canceled,
    /// The error of a biased technique no longer falls.
    Stalled,
}

impl StopReason {
    /// Its name in results.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Samples => "samples",
            Self::MaxError => "max_error",
            Self::TimeLimit => "time_limit",
            Self::Canceled => "canceled",
            Self::Stalled => "stalled",
        }
    }
}

/// The stop rules of a job, with the errors found on the way.
#[derive(Clone, Debug)]
pub(crate) struct StopPolicy {
    rules: StopRules,
    /// The technique may converge to something else than the truth, so a goal may be out of its reach.
    is_biased: bool,
    /// Samples a pixel and upper bound of the error at each audit, the latest last.
    bounds: Vec<(u32, f64)>,
}

impl StopPolicy {
    pub(crate) const fn new(rules: StopRules, is_biased: bool) -> Self {
        Self { rules, is_biased, bounds: Vec::new() }
    }

    /// The error to end at, where there is one.
    pub(crate) fn goal(&self) -> Option<f64> {
        self.rules.max_error.map(f64::from)
    }

    /// Records an audit on the way to the goal.
    pub(crate) fn record(&mut self, samples: u32, bound: f64) {
        self.bounds.push((samples, bound));
    }

    /// The first rule that ends the job. At least one sample of each pixel is taken whatever the rules say: there is no
    /// image before.
    pub(crate) fn reason(&self, samples: u32, elapsed: Duration, is_canceled: bool) -> Option<StopReason> {
        if samples == 0 {
            None
        } else if is_canceled {
            Some(StopReason::Canceled)
        } else if samples >= self.max_samples() {
            Some(StopReason::Samples)
        } else if self.rules.time_limit.is_some_and(|limit| elapsed >= limit) {
            Some(StopReason::TimeLimit)
        } else if self.goal().is_some_and(|goal| self.bound() <= goal) {
            Some(StopReason::MaxError)
        } else if self.is_stalled() {
            Some(StopReason::Stalled)
        } else {
            None
        }
    }

    /// How far to go before looking again. `next_audit` counts only for a job that ends at an error.
    pub(crate) fn until(&self, next_audit: u32) -> Until {
        let audit = if self.goal().is_some() { next_audit } else { u32::MAX };
        Until {
            samples: self.max_samples().min(audit),
            max_batch: if self.rules.time_limit.is_some() { MAX_TIMED_BATCH } else { MAX_JOB_BATCH },
        }
    }

    /// Share done by the nearest rule, in [0, 1].
    pub(crate) fn fraction(&self, samples: u32, elapsed: Duration) -> f32 {
        let by_samples = self.rules.samples.map_or(0.0, |limit| samples as f32 / limit.max(1) as f32);
        let by_time = self.rules.time_limit.map_or(0.0, |limit| elapsed.as_secs_f32() / limit.as_secs_f32().max(1e-3));
        // The error falls with the root of the samples.
        let by_error = self.goal().map_or(0.0, |goal| (goal / self.bound()).powi(2) as f32);
        by_samples.max(by_time).max(by_error).clamp(0.0, 1.0)
    }

    fn max_samples(&self) -> u32 {
        self.rules.samples.unwrap_or(MAX_SAMPLES).min(MAX_SAMPLES)
    }

    /// What the error is probably below.
    fn bound(&self) -> f64 {
        self.bounds.last().map_or(f64::INFINITY, |(_, bound)| *bound)
    }

    /// Whether an error that should have halved since a quarter of the samples has hardly fallen: what is left is bias.
    fn is_stalled(&self) -> bool {
        let Some(&(samples, bound)) = self.bounds.last() else { return false };
        let earlier = self.bounds.iter().rev().find(|(then, _)| *then <= samples / 4);
        self.is_biased && samples >= STALL_SAMPLES && earlier.is_some_and(|(_, then)| bound > STALL_SHARE * then)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    fn policy(rules: StopRules) -> StopPolicy {
        StopPolicy::new(rules, false)
    }

    #[test]
    fn a_job_ends_at_its_samples() {
        let job = policy(StopRules { samples: Some(100), ..StopRules::default() });
        assert_eq!(job.reason(99, SECOND, false), None);
        assert_eq!(job.reason(100, SECOND, false), Some(StopReason::Samples));
        assert_eq!(job.until(16), Until { samples: 100, max_batch: 64 }, "no audits on the way");
        assert!(job.fraction(25, SECOND) == 0.25);
        let endless = policy(StopRules::default());
        assert_eq!(endless.reason(MAX_SAMPLES - 1, SECOND, false), None);
        assert_eq!(endless.reason(MAX_SAMPLES, SECOND, false), Some(StopReason::Samples));
    }

    #[test]
    fn a_job_ends_at_its_error_as_far_as_audits_know_it() {
        let mut job = policy(StopRules { max_error: Some(0.5), samples: Some(1000), ..StopRules::default() });
        assert_eq!(job.until(16).samples, 16, "audited on the way");
        assert_eq!(job.until(2000).samples, 1000);
        assert_eq!(job.reason(16, SECOND, false), None, "nothing is known yet");
        assert!(job.fraction(0, SECOND) == 0.0);
        job.record(16, 1.0);
        assert_eq!(job.reason(16, SECOND, false), None);
        assert!(job.fraction(16, SECOND) == 0.25);
        job.record(64, 0.5);
        assert_eq!(job.reason(64, SECOND, false), Some(StopReason::MaxError));
        assert!(job.fraction(64, SECOND) == 1.0);
    }

    #[test]
    fn a_job_ends_at_its_time_with_one_sample_at_least() {
        let job = policy(StopRules { time_limit: Some(SECOND), ..StopRules::default() });
        assert_eq!(job.reason(0, 9 * SECOND, false), None);
        assert_eq!(job.reason(1, SECOND / 2, false), None);
        assert_eq!(job.reason(1, SECOND, false), Some(StopReason::TimeLimit));
        assert_eq!(job.until(16).max_batch, 4, "so that few pixels are left behind");
        assert!(job.fraction(1, SECOND / 2) == 0.5);
    }

    #[test]
    fn a_cancelled_job_keeps_what_it_has() {
        let job = policy(StopRules { samples: Some(1), ..StopRules::default() });
        assert_eq!(job.reason(0, SECOND, true), None);
        assert_eq!(job.reason(1, SECOND, true), Some(StopReason::Canceled));
    }

    /// Audits a quarter further each, with the error `noise / sqrt(samples) + bias`.
    fn ends_at(is_biased: bool, bias: f64) -> Option<(u32, StopReason)> {
        let mut job = StopPolicy::new(StopRules { max_error: Some(0.01), ..StopRules::default() }, is_biased);
        let mut samples = 16;
        while samples < 1 << 16 {
            job.record(samples, 0.1 / f64::from(samples).sqrt() + bias);
            if let Some(reason) = job.reason(samples, SECOND, false) {
                return Some((samples, reason));
            }
            samples += samples / 4;
        }
        None
    }

    #[test]
    fn a_biased_technique_whose_error_no_longer_falls_is_stopped() {
        assert!(matches!(ends_at(true, 0.05), Some((512..1024, StopReason::Stalled))), "{:?}", ends_at(true, 0.05));
        assert_eq!(ends_at(false, 0.05), None, "an unbiased one gets there");
        assert!(matches!(ends_at(true, 0.0), Some((100..160, StopReason::MaxError))), "{:?}", ends_at(true, 0.0));
    }

    #[test]
    fn a_technique_whose_error_still_falls_goes_on() {
        let mut job = StopPolicy::new(StopRules { max_error: Some(0.001), ..StopRules::default() }, true);
        for (samples, bound) in [(128, 0.04), (512, 0.03), (2048, 0.022)] {
            job.record(samples, bound);
            assert_eq!(job.reason(samples, SECOND, false), None, "{samples}");
        }
        job.record(8192, 0.02);
        assert_eq!(job.reason(8192, SECOND, false), Some(StopReason::Stalled));
    }
}
