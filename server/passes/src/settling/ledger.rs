//! Which image gets the next samples, decided by costs and measured errors. No device in it.

/// Share of the cost that goes into paths while frames do better, so that the error of the biased image is known:
/// without them the image would have hardly less noise.
const EXPLORED_SHARE: f64 = 1.0 / 16.0;
/// Path-traced samples per pixel from which their noise is known well enough to weight them.
pub(super) const FEWEST_SAMPLES: u32 = 4;
/// Growth of the cost between decisions.
const DECISION_GROWTH: f64 = 1.25;
/// Standard errors between the measured error of the biased image and its least and greatest value.
const CERTAINTY: f64 = 1.5;
/// Smallest share of the biased image's error that is assumed to fall with more frames.
const LEAST_FALLING: f64 = 0.02;
/// Rays of a path-traced sample, before one was taken.
const GUESSED_RAYS: f64 = 8.0;

/// Mean squares over the pixels of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Compared {
    /// Smallest error that the biased image has, as far as the noise of the paths reveals it; negative where it reveals
    /// none.
    surely: f64,
    /// Greatest error that it may have.
    perhaps: f64,
    /// Variance of the path-traced mean.
    path_noise: f64,
}

/// What the budget goes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Recipient {
    /// Frames of the biased image.
    Frames,
    /// Path-traced samples.
    Paths,
}

/// Costs and errors of both images, and what the budget goes to. Costs are counted in rays.
#[derive(Clone, Debug)]
pub(super) struct Ledger {
    pub(super) frame_cost: f64,
    pub(super) path_cost: f64,
    /// Greatest errors that the biased image may have had, by its number of frames.
    errors: Vec<(u32, f64)>,
    pub(super) recipient: Recipient,
    /// Total cost from which the next decision is due.
    next_decision: f64,
}

impl Ledger {
    pub(super) const fn new() -> Self {
        Self { frame_cost: 0.0, path_cost: 0.0, errors: Vec::new(), recipient: Recipient::Frames, next_decision: 0.0 }
    }

    /// Path-traced samples per pixel to have while the budget goes to frames, of which there are `samples` now.
    pub(super) fn explored(&self, samples: u32, pixel_count: u32) -> u32 {
        let guess = GUESSED_RAYS * f64::from(pixel_count.max(1));
        let sample_cost = if samples > 0 { self.path_cost / f64::from(samples) } else { guess };
        (self.frame_cost * EXPLORED_SHARE / sample_cost.max(1.0)) as u32
    }

    pub(super) fn is_decision_due(&self, samples: u32) -> bool {
        samples >= FEWEST_SAMPLES && self.frame_cost + self.path_cost >= self.next_decision
    }

    /// Decides what the budget goes to, from what was measured after `frames` frames.
    pub(super) fn decide(&mut self, frames: u32, found: Compared) {
        self.next_decision = (self.frame_cost + self.path_cost) * DECISION_GROWTH;
        // In doubt the budget stays with the frames: among many measurements on few pixels, one exceeds any bound by
        // chance.
        let falling = self.falling_share(frames, found.surely);
        if self.errors.last().is_none_or(|(last, _)| *last < frames) {
            self.errors.push((frames, found.perhaps));
        }
        let is_paths = found.surely * self.frame_cost > falling * found.path_noise * self.path_cost;
        self.recipient = if is_paths { Recipient::Paths } else { Recipient::Frames };
    }

    /// Share of the biased image's error `now` that falls as one over the number of frames, from the error that it may
    /// have had with half of them.
    fn falling_share(&self, frames: u32, now: f64) -> f64 {
        let earlier = self.errors.iter().rev().find(|(then, _)| *then * 2 <= frames);
        let Some(&(then, error)) = earlier.filter(|_| now > 0.0) else { return 1.0 };
        let per_frame = (error - now) / (1.0 / f64::from(then) - 1.0 / f64::from(frames));
        (per_frame / f64::from(frames) / now).clamp(LEAST_FALLING, 1.0)
    }
}

/// Errors from sums over tiles: squared differences, noise of the paths, pixels, squares of that noise.
///
/// The standard error of the sum is estimated in two ways, both of which are too large: by the scatter of tiles, which
/// also contains that of the error among them; and by the scatter 2 v^2 + 4 e v of a squared difference of noise v and
/// an error e beyond it, where v is itself overestimated from bright samples. The smaller one is used.
pub(super) fn compare(tiles: &[[f32; 4]]) -> Compared {
    let pixels = tiles.iter().map(|tile| f64::from(tile[2])).sum::<f64>().max(1.0);
    let (mut error, mut squares, mut noise, mut scatter_of_pixels) = (0.0, 0.0, 0.0, 0.0);
    for &[difference, variance, count, variance_squared] in tiles {
        let (variance, beyond) = (f64::from(variance), f64::from(difference) - f64::from(variance));
        error += beyond;
        squares += beyond * beyond;
        noise += variance;
        let error_of_pixels = beyond.max(0.0) / f64::from(count).max(1.0);
        scatter_of_pixels += 2.0 * f64::from(variance_squared) + 4.0 * error_of_pixels * variance;
    }
    let scatter_of_tiles = (squares - error * error / tiles.len().max(1) as f64).max(0.0);
    let doubt = CERTAINTY * scatter_of_pixels.min(scatter_of_tiles).sqrt();
    Compared {
        surely: (error - doubt) / pixels,
        perhaps: (error.max(0.0) + doubt) / pixels,
        path_noise: noise / pixels,
    }
}

#[cfg(test)]
mod tests {
    use super::super::FRAMES_BEFORE;
    use super::*;

    /// A biased image of the error `bias + noise / frames`, and paths of the error `path / samples`.
    fn followed(bias: f64, noise: f64, path: f64, total_cost: f64) -> (Ledger, u32, u32) {
        let (frame_cost, sample_cost) = (10.0, 4.0);
        let mut ledger = Ledger::new();
        let (mut frames, mut samples) = (0u32, 0u32);
        while ledger.frame_cost + ledger.path_cost < total_cost {
            let goal = match ledger.recipient {
                Recipient::Paths => samples + 1,
                Recipient::Frames if frames < FRAMES_BEFORE => samples,
                Recipient::Frames => ledger.explored(samples, 0),
            };
            if goal > samples {
                samples += 1;
                ledger.path_cost += sample_cost;
            } else {
                frames += 1;
                ledger.frame_cost += frame_cost;
            }
            if ledger.is_decision_due(samples) {
                let image_error = bias + noise / f64::from(frames);
                let path_noise = path / f64::from(samples);
                ledger.decide(frames, Compared { surely: image_error, perhaps: image_error, path_noise });
            }
        }
        (ledger, frames, samples)
    }

    #[test]
    fn the_budget_goes_to_paths_where_frames_stop_lowering_the_error() {
        let (ledger, _, samples) = followed(1e-4, 1e-3, 0.1, 1e5);
        assert_eq!(ledger.recipient, Recipient::Paths);
        assert!(ledger.path_cost > 0.9 * 1e5, "{samples} samples");
    }

    #[test]
    fn the_budget_stays_with_frames_that_lower_the_error_faster() {
        let (ledger, frames, _) = followed(0.0, 1e-3, 0.1, 1e5);
        assert_eq!(ledger.recipient, Recipient::Frames);
        assert!(ledger.frame_cost > 0.9 * 1e5, "{frames} frames");
    }

    #[test]
    fn the_budget_goes_at_once_to_paths_that_are_better_from_the_start() {
        let (ledger, frames, _) = followed(0.0, 1.0, 0.1, 1e4);
        assert_eq!(ledger.recipient, Recipient::Paths);
        assert!(frames < 100, "{frames} frames");
    }

    #[test]
    fn an_error_that_may_be_chance_decides_nothing() {
        let mut ledger = Ledger::new();
        (ledger.frame_cost, ledger.path_cost) = (1000.0, 1.0);
        ledger.decide(16, Compared { surely: -2e-3, perhaps: 4e-3, path_noise: 0.1 });
        assert_eq!(ledger.recipient, Recipient::Frames);
        ledger.decide(16, Compared { surely: 9.9e-4, perhaps: 1.1e-3, path_noise: 0.1 });
        assert_eq!(ledger.recipient, Recipient::Paths);
    }

    #[test]
    fn that_an_error_did_not_fall_may_be_chance_too() {
        let mut ledger = Ledger::new();
        (ledger.frame_cost, ledger.path_cost) = (6e5, 3e4);
        ledger.decide(15, Compared { surely: -4e-4, perhaps: 3e-4, path_noise: 1.5e-3 });
        assert_eq!(ledger.recipient, Recipient::Frames);
        // There is an error, apparently as large as before. It may still have been ten times as large.
        (ledger.frame_cost, ledger.path_cost) = (1.25e6, 7.3e4);
        ledger.decide(33, Compared { surely: 1.5e-5, perhaps: 4.5e-5, path_noise: 2.8e-4 });
        assert_eq!(ledger.recipient, Recipient::Frames);
    }

    /// A tile of 64 pixels with this error and noise of paths.
    fn tile(error: f32, noise: f32) -> [f32; 4] {
        [(error + noise) * 64.0, noise * 64.0, 64.0, noise * noise * 64.0]
    }

    #[test]
    fn tiles_give_the_error_and_its_standard_error() {
        let is_near = |value: f64, wanted: f64| (value / wanted - 1.0).abs() < 1e-6;
        // A mean of 20; the scatter of the two sums is 128.
        let found = compare(&[tile(21.0, 100.0), tile(19.0, 100.0)]);
        let doubt = CERTAINTY * 2f64.sqrt() / 2.0;
        assert!(is_near(found.surely, 20.0 - doubt) && is_near(found.perhaps, 20.0 + doubt), "{found:?}");
        assert!(is_near(found.path_noise, 100.0), "{found:?}");
        // Where one tile has all of the error, the noise gives the smaller standard error.
        let found = compare(&[tile(40.0, 0.1), tile(0.0, 0.1)]);
        let doubt = CERTAINTY * (64.0 * (4.0 * 0.01 + 4.0 * 40.0 * 0.1f64)).sqrt() / 128.0;
        assert!(is_near(found.surely, 20.0 - doubt), "{found:?}");
    }

    #[test]
    fn a_bright_sample_is_no_error() {
        let bright = [2e6, 1e6, 64.0, 1e12];
        let found = compare(&[tile(0.0, 1.0), tile(0.0, 1.0), bright]);
        assert!(found.surely <= 0.0 && found.perhaps > 1e3, "{found:?}");
    }
}
