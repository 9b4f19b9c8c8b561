//! Runs the program with the surfel cache and with path tracing.

use surfelcast::Failure;
use surfelcast_measure::{Image, MeasureError, Mode, Point, Rectangle, Reference, Renderer, error_to_truth};

use crate::report::input;
use crate::studies::surfels::{GATES, Outcome};

/// Frames of an early image and of a later one.
pub(super) const FRAMES: [u32; 2] = [32, 64];
/// Samples per pixel of each of the two path-traced images whose mean is the truth of indirect light.
const TRUTH_SAMPLES: u32 = 32;
/// Images of indirect light alone have a truth of their own, so they can be smaller than the references: a third as
/// wide.
const INDIRECT_SHRINK: u32 = 3;
/// Ratio of errors above which the image is measured again at full size.
const FULL_SIZE_RATIO: f64 = 0.4;

/// Both ways to render.
#[derive(Debug)]
pub(super) struct Programs {
    surfel: Renderer,
    path: Renderer,
}

/// A way to render with more words on its command line.
fn with(program: &Renderer, words: &[&str]) -> Renderer {
    let mut program = program.clone();
    program.arguments.extend(words.iter().map(|&word| word.to_owned()));
    program
}

impl Programs {
    pub(super) fn find(device_words: &[String]) -> Result<Self, Failure> {
        let find = |technique: &str| {
            let mut program = Renderer::find(technique)?;
            program.arguments = device_words.to_vec();
            Ok::<_, MeasureError>(program)
        };
        let surfel = find("surfel").map_err(input)?;
        Ok(Self { surfel: with(&surfel, &["--set", "settling=off"]), path: find("path").map_err(input)? })
    }

    pub(super) fn gate(&self, reference: &Reference) -> Result<Outcome, MeasureError> {
        let early = self.surfel.measure(reference, FRAMES[0])?;
        let path = self.path_at_equal_rays(reference, early.rays)?;
        let late = self.surfel.measure(reference, FRAMES[1])?;
        let gate = GATES.iter().find(|(name, _)| *name == reference.name).map_or(0.0, |(_, gate)| *gate);
        Ok(Outcome::Gate { gate, noise: reference.noise_rmse, early, late, path })
    }

    pub(super) fn radius(&self, reference: &Reference, radius: &str) -> Result<Outcome, MeasureError> {
        let program = with(&self.surfel, &["--set", &format!("radius={radius}")]);
        let [early, late] = [program.measure(reference, FRAMES[0])?, program.measure(reference, FRAMES[1])?];
        Ok(Outcome::Radius { noise: reference.noise_rmse, early, late })
    }

    /// Indirect light of references with Lambertian materials, whole images of the others.
    pub(super) fn indirect(&self, reference: &Reference) -> Result<Outcome, MeasureError> {
        if reference.mode != Mode::Lambert {
            return self.at_equal_rays(reference, false);
        }
        let small = self.at_equal_rays(&shrunk(reference), true)?;
        match small {
            // Small images give small objects few surfels.
            Outcome::Indirect { ours, theirs, .. } if ours > FULL_SIZE_RATIO * theirs => {
                self.at_equal_rays(reference, true)
            }
            small => Ok(small),
        }
    }

    /// Path tracing with `rays` rays: an image with one sample per pixel gives the rays of a sample.
    fn path_at_equal_rays(&self, reference: &Reference, rays: f64) -> Result<Point, MeasureError> {
        let one = self.path.measure(reference, 1)?;
        self.path.measure(reference, samples_of(rays, one.rays))
    }

    fn at_equal_rays(&self, reference: &Reference, is_indirect: bool) -> Result<Outcome, MeasureError> {
        let words: &[&str] = if is_indirect { &["--aov", "indirect"] } else { &[] };
        let [surfel, path] = [&self.surfel, &self.path].map(|program| with(program, words));
        let (truth, noise) = if is_indirect {
            let [a, b] = [11, 12].map(|seed| path.image(reference, TRUTH_SAMPLES, seed));
            let (a, b) = (a?.0, b?.0);
            // The mean of both has half the noise of their difference.
            let noise = a.tone_mapped_mse(&b, reference.exposure) / 4.0;
            (a.mean_with(&b), noise)
        } else {
            (Image::read_exr(&reference.image)?, reference.noise_rmse.powi(2))
        };
        let error = |image: &Image| error_to_truth(reference, image, &truth, noise);
        let (ours, rays) = surfel.image(reference, FRAMES[0], 1)?;
        let (_, rays_each) = path.image(reference, 1, 1)?;
        let samples = samples_of(rays, rays_each);
        let (theirs, _) = path.image(reference, samples, 1)?;
        let (ours, theirs) = (error(&ours), error(&theirs));
        Ok(Outcome::Indirect { is_indirect, size: reference.size, ours, theirs, samples })
    }
}

/// Samples per pixel that take `rays` rays, at least one.
fn samples_of(rays: f64, rays_each: f64) -> u32 {
    (rays / rays_each).round().max(1.0) as u32
}

/// A reference for smaller images. Its own image no longer fits.
fn shrunk(reference: &Reference) -> Reference {
    let by = INDIRECT_SHRINK as usize;
    let masked = reference
        .masked
        .iter()
        .map(|part| Rectangle { start: part.start.map(|at| at / by), end: part.end.map(|at| at.div_ceil(by)) });
    Reference { size: reference.size.map(|side| side / INDIRECT_SHRINK), masked: masked.collect(), ..reference.clone() }
}
