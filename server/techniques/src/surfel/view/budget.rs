//! What a view spends on a frame: radius of its surfels, rays of an update, samples per pixel, and when it looks for
//! gaps. No device in it.

use surfelcast_passes::settling::FRAMES_BEFORE;
use surfelcast_shaders::constants::SURFEL_COARSENESS;

/// Rays of an update, at least: a tiny image still shows a whole scene. And at most.
const RAY_RANGE: [u32; 2] = [4096, 1 << 22];
/// Rays of an update for each surfel spawned since the last one, at least. Surfels are denser among the pixels of a
/// small image, whose rays follow its number of pixels: they would have hardly one each, and pixels would show single
/// paths.
const RAYS_OF_NEW: u32 = 8;
/// Surfels that a view gains in a frame, over its tiles, from which it drives an update although another view just has;
/// new surfels come first in it.
const MUCH_GAIN: f32 = 0.1;
/// Samples per pixel in the first eight frames. A sample costs c = 1/4 of the frame's fixed cost, so variance x time is
/// least at n = sqrt(share / (1 - share) / c): 2 if half the variance is per-pixel noise. Scaled by sqrt(rays /
/// configured rays). Later frames take one: the path-traced image has samples of its own by then, and whether pixels or
/// surfels need more is decided by the settling pass.
const SAMPLES_OF_FRAME: [f32; FRAMES_BEFORE as usize] = [2.0, 3.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0];
/// Samples per pixel of one frame, at most.
const MOST_SAMPLES: f32 = 16.0;
/// One extra sample per pixel for every 1/8 cache ray per pixel. A converged cache traces none, and gets none.
const PIXELS_PER_RAY: f32 = 8.0;
/// Gain below which the view is covered, and the number of frames that then do not look for gaps.
const QUIET_GAIN: f32 = 0.01;
const QUIET_FRAMES: u32 = 3;

/// Budget of one view's frames.
#[derive(Clone, Debug)]
pub(crate) struct Budget {
    /// Size of the image, pixels.
    size: [u32; 2],
    /// Height of the full image, whose pixels decide on the surfels' radii.
    full_height: u32,
    /// Radius of surfels in pixels of the full image, as configured.
    radius_pixels: f32,
    /// Cache rays per pixel, as configured.
    rays_per_pixel: f32,
    /// Frames left that do not look for gaps.
    quiet_frames: u32,
}

/// The update that a view's frame drives, if any.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum UpdateChoice {
    /// The view uses the newest update, which another view drove, or the cache has converged.
    Use,
    /// The view drives the next update.
    Drive,
    /// It drives the next update, in which new surfels get most of the rays.
    DriveNewFirst,
}

impl UpdateChoice {
    /// What a frame that gained `gain` does, with the update that the view has seen last and the cache's next one.
    pub(crate) fn of(gain: f32, seen: u32, next: u32, is_converged: bool) -> Self {
        if gain >= MUCH_GAIN || next <= 1 {
            Self::DriveNewFirst
        } else if seen >= next && !is_converged {
            Self::Drive
        } else {
            Self::Use
        }
    }
}

impl Budget {
    pub(crate) fn new(size: [u32; 2], full_height: u32, radius_pixels: f32, rays_per_pixel: f32) -> Self {
        Self { size, full_height, radius_pixels, rays_per_pixel, quiet_frames: 0 }
    }

    /// Surfels are as dense as the full image needs them, so that those of a gesture fit the still after it. An image
    /// of less than half that size could neither cover itself with as many nor light them: where there are none it
    /// requests coarser ones, which a larger image refines.
    pub(crate) fn is_coarse(&self) -> bool {
        self.size[1].saturating_mul(2) < self.full_height
    }

    /// Radius of the surfels that the view requests, in its own pixels.
    pub(crate) fn requested_radius(&self) -> f32 {
        let coarseness = if self.is_coarse() { SURFEL_COARSENESS } else { 1.0 };
        let share = self.size[1] as f32 / self.full_height.max(1) as f32;
        self.radius_pixels * coarseness * share
    }

    /// Rays of an update that the view drives, with `new_surfels` spawned since the last one. Images of a gesture are
    /// small to be fast, and so are their updates.
    pub(crate) fn rays(&self, new_surfels: u32) -> u32 {
        let [width, height] = self.size;
        let rays = width as f32 * height as f32 * self.rays_per_pixel;
        (rays as u32).max(new_surfels.saturating_mul(RAYS_OF_NEW)).clamp(RAY_RANGE[0], RAY_RANGE[1])
    }

    /// Whether the next frame, with `frames` before it, looks for gaps.
    pub(crate) fn looks_for_gaps(&mut self, frames: u32) -> bool {
        let is_quiet = frames > 0 && self.quiet_frames > 0;
        if is_quiet {
            self.quiet_frames -= 1;
        }
        !is_quiet
    }

    /// Records what a frame that looked for gaps gained: surfels over tiles.
    pub(crate) fn gained(&mut self, gain: f32) {
        self.quiet_frames = if gain < QUIET_GAIN { QUIET_FRAMES } else { 0 };
    }

    /// Samples per pixel of a frame with `frames` before it, while the cache traces `cache_rays`.
    pub(crate) fn samples(&self, frames: u32, cache_rays: u32) -> u32 {
        let pixel_count = self.size[0] * self.size[1];
        samples_of_frame(frames, cache_rays as f32 / pixel_count.max(1) as f32, self.rays_per_pixel)
    }
}

/// Samples per pixel of the next frame, from the frames accumulated, the cache rays per pixel traced this frame, and
/// the configured rays per pixel.
fn samples_of_frame(frames: u32, cache_rays: f32, configured: f32) -> u32 {
    let more = (cache_rays / configured).max(1.0);
    let samples = SAMPLES_OF_FRAME.get(frames as usize).copied().unwrap_or(1.0) * more.sqrt();
    // The first frame is shown as soon as possible, and while something moves there is no other.
    let most = if frames == 0 { more } else { MOST_SAMPLES };
    let worth = 1.0 + (cache_rays * PIXELS_PER_RAY).floor();
    samples.min(most).min(worth).min(MOST_SAMPLES).round() as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn budget(size: [u32; 2], full_height: u32) -> Budget {
        Budget::new(size, full_height, 5.0, 0.5)
    }

    #[test]
    fn a_frame_takes_as_many_samples_as_its_rays_are_worth() {
        let of = |rays: f32| [0, 1, 2, 20].map(|frames| samples_of_frame(frames, rays, 0.5));
        assert_eq!(of(0.5), [1, 3, 2, 1], "the configured rays");
        assert_eq!(of(2.0), [4, 6, 4, 2], "four times that, as in a tiny image");
        assert_eq!(of(0.1), [1, 1, 1, 1], "a converged cache");
        assert_eq!(of(1e9), [16; 4]);
        assert_eq!(of(0.0), [1; 4]);
        assert_eq!(budget([100, 50], 50).samples(0, 10_000), 4, "two rays a pixel");
        assert_eq!(budget([0, 0], 0).samples(0, 0), 1);
    }

    #[test]
    fn images_of_less_than_half_the_height_request_coarser_surfels() {
        assert!(!budget([200, 100], 200).is_coarse());
        assert!((budget([200, 100], 200).requested_radius() - 2.5).abs() < 1e-6);
        assert!(budget([198, 99], 200).is_coarse());
        assert!((budget([198, 99], 200).requested_radius() - 5.0 * SURFEL_COARSENESS * 0.495).abs() < 1e-5);
    }

    #[test]
    fn rays_follow_the_pixels_and_the_new_surfels_within_bounds() {
        let budget = budget([200, 100], 100);
        assert_eq!(budget.rays(0), 10_000);
        assert_eq!(budget.rays(2_000), 16_000);
        assert_eq!(budget.rays(u32::MAX), RAY_RANGE[1]);
        assert_eq!(Budget::new([8, 8], 8, 5.0, 0.5).rays(0), RAY_RANGE[0]);
    }

    #[test]
    fn a_covered_view_looks_for_gaps_in_every_fourth_frame() {
        let mut budget = budget([200, 100], 100);
        let mut looks = Vec::new();
        for frame in 0..6 {
            looks.push(budget.looks_for_gaps(frame));
            if looks[frame as usize] {
                budget.gained(0.0);
            }
        }
        assert_eq!(looks, [true, false, false, false, true, false]);
        assert!(budget.looks_for_gaps(0), "the camera moved");
        budget.gained(QUIET_GAIN);
        assert!(budget.looks_for_gaps(1), "it is not covered yet");
    }

    #[test]
    fn a_view_drives_an_update_unless_another_did() {
        assert_eq!(UpdateChoice::of(0.0, 0, 1, false), UpdateChoice::DriveNewFirst, "the first update");
        assert_eq!(UpdateChoice::of(0.0, 7, 7, false), UpdateChoice::Drive);
        assert_eq!(UpdateChoice::of(0.0, 6, 7, false), UpdateChoice::Use, "another view drove one");
        assert_eq!(UpdateChoice::of(0.0, 7, 7, true), UpdateChoice::Use, "the cache has converged");
        assert_eq!(UpdateChoice::of(0.2, 6, 7, true), UpdateChoice::DriveNewFirst, "newly visible surfaces");
    }
}
