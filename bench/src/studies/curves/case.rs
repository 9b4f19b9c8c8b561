//! What is rendered, and what it is compared with.

use std::path::{Path, PathBuf};

use surfelcast::Failure;
use surfelcast_gpu::Gpu;
use surfelcast_measure::{Image, Mode, Rectangle, Reference};
use surfelcast_render_api::Settings;
use surfelcast_scene::{Camera, Scene};
use surfelcast_stream::encode_exr;
use surfelcast_techniques::SessionState;

use crate::report::{input, write_file};
use crate::stage::Stage;
use surfelcast::args::Materials;
use surfelcast::scene_file;

/// Size of images if nothing states one.
const DEFAULT_SIZE: [u32; 2] = [256, 192];
/// The technique whose images are the truth if there is no reference, and the seed of its first half.
const TRUTH_TECHNIQUE: &str = "path";
const TRUTH_SEED: u64 = 0x7472_7574;

/// A scene as the command line names it.
pub(crate) struct Requested<'a> {
    /// Name of a reference or of a scene with references, a file, or `demo:NAME`.
    pub(crate) scene: &'a str,
    pub(crate) camera: Option<&'a str>,
    pub(crate) size: Option<RequestedSize>,
    pub(crate) materials: Materials,
    /// Indirect light alone is compared, demodulated.
    pub(crate) is_indirect: bool,
    /// Image to compare with.
    pub(crate) reference: Option<&'a Path>,
}

/// An image's size where it is not the reference's.
#[derive(Clone, Copy, Debug)]
pub(crate) enum RequestedSize {
    Both([u32; 2]),
    /// The height follows the reference's shape.
    Width(u32),
}

impl RequestedSize {
    /// The size for a reference of that size. The height is rounded to a whole number.
    fn for_reference(self, [width, height]: [u32; 2]) -> [u32; 2] {
        match self {
            Self::Both(size) => size,
            Self::Width(requested) => {
                let scaled = f64::from(requested) * f64::from(height) / f64::from(width.max(1));
                [requested, (scaled.round() as u32).max(1)]
            }
        }
    }
}

/// An image to render.
pub(crate) struct Case {
    /// `<scene>_<camera>_<mode>`.
    pub(crate) name: String,
    pub(crate) scene: Scene,
    pub(crate) camera: Camera,
    pub(crate) mode: Mode,
    pub(crate) size: [u32; 2],
    pub(crate) exposure: f32,
    source: Source,
}

/// Where the truth comes from.
enum Source {
    Reference {
        image: PathBuf,
        noise: f64,
        masked: Vec<Rectangle>,
        /// Pixels of the reference, across and down, that make one of the image.
        factor: u32,
    },
    /// To be rendered.
    Rendered,
}

/// What images are compared with.
pub(crate) struct Truth {
    image: Image,
    masked: Vec<Rectangle>,
    /// Its own tone-mapped RMSE.
    pub(crate) noise: f64,
    /// Where it comes from, for people.
    pub(crate) source: String,
}

impl Truth {
    /// The truth without the parts that are known to mean something else.
    pub(crate) fn compared(&self) -> Image {
        self.image.without(&self.masked)
    }

    /// The same parts of an image.
    pub(crate) fn comparable(&self, image: &Image) -> Image {
        image.without(&self.masked)
    }

    /// The whole truth, for metrics that look at neighbourhoods.
    pub(crate) fn whole(&self) -> &Image {
        &self.image
    }
}

fn mode_name(mode: Mode) -> &'static str {
    match mode {
        Mode::Lambert => "lambert",
        Mode::Pbr => "pbr",
        Mode::Indirect => "indirect",
    }
}

impl Requested<'_> {
    fn mode(&self) -> Mode {
        match self.materials {
            _ if self.is_indirect => Mode::Indirect,
            Materials::Pbr => Mode::Pbr,
            Materials::Lambert => Mode::Lambert,
        }
    }
}

impl Case {
    /// Finds the scene, among references first, and reads it.
    pub(crate) fn find(requested: &Requested<'_>, shared: Option<&Path>) -> Result<Self, Failure> {
        let looks_like_file = requested.scene.contains(['/', '\\', ':', '.']);
        if requested.reference.is_none() && !looks_like_file {
            let shared = shared.ok_or_else(|| {
                Failure::input(format!(
                    "--scene {}: there are no references here; set SURFELCAST_SHARED to a folder with references/ and \
                     scenes/, give a file with --reference, or take demo:cornell_box",
                    requested.scene
                ))
            })?;
            return Self::of_reference(requested, shared);
        }
        let scene = scene_file::load(Path::new(requested.scene), None, None)?;
        let camera = scene_file::camera_of(&scene, requested.camera)?.clone();
        let mode = requested.mode();
        let (mut size, mut source) = match requested.reference {
            None => (DEFAULT_SIZE, Source::Rendered),
            Some(image) => {
                let [width, height] = Image::read_exr(image).map_err(input)?.size;
                let noise = stated_noise(image).unwrap_or(0.0);
                let source = Source::Reference { image: image.to_owned(), noise, masked: Vec::new(), factor: 1 };
                ([width as u32, height as u32], source)
            }
        };
        if let Some(requested) = requested.size.map(|requested| requested.for_reference(size)) {
            if let Source::Reference { factor, .. } = &mut source {
                *factor = whole_factor(size, requested).ok_or_else(|| {
                    Failure::input(format!(
                        "--size, --width: the reference is {} x {}; give that size or a whole part of it",
                        size[0], size[1]
                    ))
                })?;
            }
            size = requested;
        }
        Ok(Self {
            name: format!("{}_{}_{}", scene.name, camera.name, mode_name(mode)),
            exposure: scene.exposure_for(&camera.name),
            camera: camera.camera,
            scene,
            mode,
            size,
            source,
        })
    }

    fn of_reference(requested: &Requested<'_>, shared: &Path) -> Result<Self, Failure> {
        let references = Reference::read_all(shared).map_err(input)?;
        let name = requested.scene;
        let mode = requested.mode();
        let of_scene = |mode: Mode| {
            let is_it = |one: &&Reference| {
                one.scene.file_stem().is_some_and(|stem| stem == name)
                    && one.mode == mode
                    && requested.camera.is_none_or(|camera| one.camera == camera)
            };
            // The scene's own order of cameras, not that of the files' names, says which is the first.
            let main = references.iter().filter(is_it).find(|one| one.camera == "main");
            main.or_else(|| references.iter().find(is_it))
        };
        let reference = references
            .iter()
            .find(|one| one.name == name)
            .or_else(|| of_scene(mode))
            // Few references are of indirect light alone; the others give at least scene and camera.
            .or_else(|| if requested.is_indirect { of_scene(Mode::Lambert) } else { None })
            .ok_or_else(|| {
                let known: Vec<_> = references.iter().map(|one| one.name.as_str()).collect();
                Failure::input(format!(
                    "--scene {name}: there is no reference and no scene with a {} reference of that name; there are {}",
                    mode_name(mode),
                    known.join(", ")
                ))
            })?;
        let scene = scene_file::load(&reference.scene, None, None)?;
        let camera = scene_file::camera_of(&scene, Some(&reference.camera))?.camera;
        let mode = if requested.is_indirect { Mode::Indirect } else { reference.mode };
        // Another output, or a size that does not divide the reference's, needs a truth of its own.
        let size = requested.size.map_or(reference.size, |requested| requested.for_reference(reference.size));
        let source = match whole_factor(reference.size, size) {
            Some(factor) if reference.mode == mode => Source::Reference {
                image: reference.image.clone(),
                noise: reference.noise_rmse,
                masked: reference.masked.clone(),
                factor,
            },
            _ => Source::Rendered,
        };
        Ok(Self {
            name: if reference.mode == mode {
                reference.name.clone()
            } else {
                format!("{}_{}_{}", scene.name, reference.camera, mode_name(mode))
            },
            scene,
            camera,
            mode,
            size,
            exposure: reference.exposure as f32,
            source,
        })
    }

    /// The device state for images of this case.
    pub(crate) fn stage<'a>(&'a self, gpu: &'a Gpu) -> Result<Stage<'a>, Failure> {
        Stage::new(gpu, &self.scene, self.mode, self.size, self.exposure)
    }

    /// Reads the reference, or path-traces one in two halves whose difference gives its noise. They are kept in
    /// `folder`.
    pub(crate) fn truth(&self, stage: &Stage<'_>, samples: u32, folder: &Path) -> Result<Truth, Failure> {
        if let Source::Reference { image, noise, masked, factor } = &self.source {
            let factor = *factor as usize;
            let averaged = Image::read_exr(image).map_err(input)?.averaged_down(factor).ok_or_else(|| {
                Failure::input(format!("{}: its size is not the one that its JSON states", image.display()))
            })?;
            return Ok(Truth {
                image: averaged,
                masked: masked.iter().map(|rectangle| rectangle.averaged_down(factor)).collect(),
                // That of independent pixels.
                noise: noise / factor as f64,
                source: image.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            });
        }
        let half_samples = (samples / 2).max(1);
        let [width, height] = self.size;
        let half = |number: u64| -> Result<Image, Failure> {
            let file = folder.join(format!("{}_{width}x{height}_{half_samples}_{number}.exr", self.name));
            if !file.is_file() {
                let mut shot = stage.shot(
                    TRUTH_TECHNIQUE,
                    &Settings::default(),
                    self.camera,
                    TRUTH_SEED + number,
                    &SessionState::default(),
                )?;
                shot.render(half_samples, f64::INFINITY)?;
                let pixels: Vec<_> = shot.image()?.pixels.iter().map(|pixel| pixel.map(|v| v as f32)).collect();
                let bytes = encode_exr(&pixels, self.size).map_err(|error| Failure::runtime(error.to_string()))?;
                write_file(&file, &bytes)?;
            }
            Image::read_exr(&file).map_err(input)
        };
        let [one, other] = [half(0)?, half(1)?];
        let noise = one.tone_mapped_mse(&other, f64::from(self.exposure)).sqrt() / 2.0;
        Ok(Truth {
            image: one.mean_with(&other),
            masked: Vec::new(),
            noise,
            source: format!("{TRUTH_TECHNIQUE}, {} samples", 2 * half_samples),
        })
    }
}

/// The pixels of an image, across and down, that make one of a smaller image of the same shape, if that is a whole
/// number.
fn whole_factor(size: [u32; 2], smaller: [u32; 2]) -> Option<u32> {
    let factor = size[0].checked_div(smaller[0])?;
    (factor > 0 && smaller.map(|side| side.saturating_mul(factor)) == size).then_some(factor)
}

/// The noise that the JSON of a reference states.
fn stated_noise(image: &Path) -> Option<f64> {
    let text = std::fs::read_to_string(image.with_extension("json")).ok()?;
    let json: serde_json::Value = serde_json::from_str(&text).ok()?;
    json["noise"]["rmse_tm"].as_f64()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reference_is_averaged_where_it_is_a_whole_number_of_times_as_large() {
        assert_eq!(whole_factor([320, 180], [32, 18]), Some(10));
        assert_eq!(whole_factor([320, 180], [320, 180]), Some(1));
        for other in [[32, 32], [64, 18], [640, 360], [100, 56], [0, 0]] {
            assert_eq!(whole_factor([320, 180], other), None, "{other:?}");
        }
    }

    #[test]
    fn a_width_keeps_the_shape() {
        assert_eq!(RequestedSize::Width(32).for_reference([320, 180]), [32, 18]);
        assert_eq!(RequestedSize::Width(1).for_reference([320, 100]), [1, 1], "no image without a row");
        assert_eq!(RequestedSize::Both([7, 5]).for_reference([320, 180]), [7, 5]);
    }
}
