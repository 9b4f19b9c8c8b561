//! From a request to all that the pixels depend on: one table of defaults, one set of checks, whoever asks.

use std::time::Duration;

use glam::DVec3;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use surfelcast_scene::{Camera, Scene};

use crate::catalogue::Catalogue;
use crate::check::{camera, within};
use crate::fault::Fault;
use crate::request::{CameraRequest, RenderRequest, Whole};
use crate::settings::Settings;

/// Size where neither the request nor the camera states one.
pub const DEFAULT_SIZE: [u32; 2] = [1280, 720];
/// Samples a pixel where no stop rule is given.
pub const DEFAULT_SAMPLES: u32 = 64;
/// Seed where none is given.
pub const DEFAULT_SEED: u64 = 0;
/// Exposure where neither the request nor the scene states one.
pub const DEFAULT_EXPOSURE: f32 = 1.0;
/// Smallest and largest exposure.
const EXPOSURE: (f64, f64) = (1e-6, 1e6);
/// Smallest and largest goal of the error audit.
const MAX_ERROR: (f64, f64) = (1e-6, 1.0);
/// Shortest time limit, seconds.
const LEAST_SECS: f64 = 0.001;
/// The setting that has a field of its own, and its value that any technique accepts.
const RECONSTRUCTION: &str = "reconstruction";
const NO_RECONSTRUCTION: &str = "none";
/// Cameras that a refusal lists at most.
const LISTED_CAMERAS: usize = 32;

/// How surfaces scatter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MaterialMode {
    /// glTF metallic-roughness with its extensions.
    #[default]
    Pbr,
    /// Two-sided Lambertian of the base colour.
    Lambert,
}

/// When to stop; whichever holds first. At least one must be set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StopRules {
    /// Samples a pixel.
    pub samples: Option<u32>,
    /// Tone-mapped RMSE by the error audit.
    pub max_error: Option<f32>,
    /// Wall time of rendering.
    pub time_limit: Option<Duration>,
}

/// A request with nothing left open: equal ones give equal pixels on one device, unless a time limit ends them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RenderSpec {
    /// Key of the scene in its state.
    pub scene: String,
    /// Camera, world space.
    #[serde(serialize_with = "write_camera", deserialize_with = "read_camera")]
    pub camera: Camera,
    /// Pixels.
    pub size: [u32; 2],
    /// Technique id, no alias.
    pub technique: String,
    /// Every setting of the technique.
    pub settings: Settings,
    /// Materials.
    pub materials: MaterialMode,
    /// Seed of all random numbers.
    pub seed: u64,
    /// When to stop.
    pub stop: StopRules,
    /// Exposure used by the error metric (pixels stay unexposed).
    pub exposure: f32,
    /// Output by its id; `None` = radiance.
    pub aov: Option<String>,
}

/// Bounds on what may be requested.
#[derive(Clone, Copy, Debug)]
pub struct RequestLimits {
    /// Width or height.
    pub side: u32,
    /// Pixels.
    pub pixels: u64,
    /// Samples a pixel.
    pub samples: u32,
    /// Seconds of a time limit.
    pub secs: f64,
}

/// What a scene says about how it is seen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneDefaults {
    /// Scene in its state ([`surfelcast_scene::SceneKey`]).
    pub id: String,
    /// Its cameras, the default first.
    pub cameras: Vec<CameraDefaults>,
}

/// A camera of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraDefaults {
    /// Name.
    pub name: String,
    /// The camera.
    pub camera: Camera,
    /// Size its author meant.
    pub size: Option<[u32; 2]>,
    /// Exposure its author meant.
    pub exposure: f32,
}

impl SceneDefaults {
    /// Of a scene.
    pub fn of(scene: &Scene) -> Self {
        let cameras = scene.cameras.iter().map(|named| CameraDefaults {
            name: named.name.clone(),
            camera: named.camera,
            size: named.resolution,
            exposure: scene.exposure_for(&named.name),
        });
        Self { id: scene.key().to_string(), cameras: cameras.collect() }
    }
}

/// What a request says without its scene.
struct Parts {
    camera: Option<Camera>,
    size: Option<[u32; 2]>,
    technique: &'static str,
    settings: Settings,
    stop: StopRules,
    seed: u64,
    materials: MaterialMode,
    exposure: Option<f32>,
    aov: Option<&'static str>,
}

impl RenderRequest {
    /// Checks all that can be checked before the scene is read.
    pub fn check(&self, catalogue: &Catalogue, limits: &RequestLimits) -> Result<(), Fault> {
        self.parts(catalogue, limits).map(drop)
    }

    /// Fills in every default.
    pub fn resolve(
        &self,
        catalogue: &Catalogue,
        scene: &SceneDefaults,
        limits: &RequestLimits,
    ) -> Result<RenderSpec, Fault> {
        let parts = self.parts(catalogue, limits)?;
        let named = match &self.camera_name {
            Some(name) => Some(scene.cameras.iter().find(|camera| camera.name == *name).ok_or_else(|| {
                let names: Vec<&str> =
                    scene.cameras.iter().take(LISTED_CAMERAS).map(|camera| camera.name.as_str()).collect();
                Fault::value("camera_name", format!("the scene has no such camera; it has {}", names.join(", ")))
            })?),
            None if parts.camera.is_some() => None,
            None => scene.cameras.first(),
        };
        let camera = parts
            .camera
            .or(named.map(|named| named.camera))
            .ok_or_else(|| Fault::value("camera", "missing, and the scene has none"))?;
        let size = parts.size.or(named.and_then(|named| named.size)).unwrap_or(DEFAULT_SIZE);
        if u64::from(size[0]) * u64::from(size[1]) > limits.pixels {
            return Err(Fault::value("width x height", format!("more than the limit of {} pixels", limits.pixels)));
        }
        Ok(RenderSpec {
            scene: scene.id.clone(),
            camera,
            size,
            technique: parts.technique.to_owned(),
            settings: parts.settings,
            materials: parts.materials,
            seed: parts.seed,
            stop: parts.stop,
            exposure: parts.exposure.or(named.map(|named| named.exposure)).unwrap_or(DEFAULT_EXPOSURE),
            aov: parts.aov.map(str::to_owned),
        })
    }

    fn parts(&self, catalogue: &Catalogue, limits: &RequestLimits) -> Result<Parts, Fault> {
        if self.camera.is_some() && self.camera_name.is_some() {
            return Err(Fault::value("camera, camera_name", "only one of the two may be given"));
        }
        let side = |name, value| whole(name, value, 1, limits.side.into());
        let size = match (side("width", self.width)?, side("height", self.height)?) {
            (Some(width), Some(height)) => Some([width as u32, height as u32]),
            (None, None) => None,
            _ => return Err(Fault::value("width, height", "give both or none")),
        };
        let (technique, settings) = self.technique_and_settings(catalogue)?;
        Ok(Parts {
            camera: self.camera.as_ref().map(camera_of).transpose()?,
            size,
            technique,
            settings,
            stop: self.stop(limits)?,
            seed: whole("seed", self.seed, 0, u64::MAX)?.unwrap_or(DEFAULT_SEED),
            materials: match self.materials.as_deref() {
                None => MaterialMode::default(),
                Some("pbr") => MaterialMode::Pbr,
                Some("lambert") => MaterialMode::Lambert,
                Some(_) => return Err(Fault::value("materials", "must be pbr or lambert")),
            },
            exposure: number("exposure", self.exposure, EXPOSURE)?.map(|exposure| exposure as f32),
            aov: self.aov(catalogue, technique)?,
        })
    }

    fn technique_and_settings(&self, catalogue: &Catalogue) -> Result<(&'static str, Settings), Fault> {
        let id = self.technique.as_deref().unwrap_or(catalogue.default_technique);
        let Some(chosen) = catalogue.choose(id) else {
            let ids: Vec<&str> = catalogue.technique_ids().map(|(id, ..)| id).collect();
            return Err(Fault::value("technique", format!("must be one of {}", ids.join(", "))));
        };
        let technique = chosen.technique;
        let lacks = |what: &str, others: &str| {
            format!("technique {} has no {what}; leave it out, or take a technique that has: {others}", technique.id)
        };
        let mut settings = chosen.settings;
        if let Some(preset) = &self.preset {
            if technique.presets.is_empty() {
                let others = catalogue.ids_where(|other| !other.presets.is_empty());
                return Err(Fault::value("preset", lacks("presets", &others)));
            }
            settings = settings.with(&technique.preset(preset)?);
        }
        if let Some(name) = &self.reconstruction {
            if let Some(setting) = technique.setting(RECONSTRUCTION) {
                settings.set(setting, &setting.parse(name)?)?;
            } else if name != NO_RECONSTRUCTION {
                let others = catalogue.ids_where(|other| other.setting(RECONSTRUCTION).is_some());
                return Err(Fault::value(RECONSTRUCTION, lacks("such setting", &others)));
            }
        }
        for (id, value) in self.settings.iter().flatten().filter(|(_, value)| !value.is_null()) {
            let others = catalogue.ids_where(|other| other.setting(id).is_some());
            if technique.setting(id).is_none() && !others.is_empty() {
                return Err(Fault::value(id, lacks("such setting", &others)).inside("settings"));
            }
            settings.set_json(technique.settings, id, value).map_err(|fault| fault.inside("settings"))?;
        }
        Ok((technique.id, settings))
    }

    fn stop(&self, limits: &RequestLimits) -> Result<StopRules, Fault> {
        let samples = whole("samples_per_pixel", self.samples_per_pixel, 1, limits.samples.into())?;
        // A progressive technique adds one sample a pixel and frame, so the two count the same thing.
        let frames = whole("frames", self.frames, 1, limits.samples.into())?;
        if samples.is_some() && frames.is_some() {
            return Err(Fault::value("samples_per_pixel, frames", "only one of the two may be given"));
        }
        let samples = samples.or(frames).map(|samples| samples as u32);
        let max_error = number("max_error", self.max_error, MAX_ERROR)?.map(|error| error as f32);
        let secs = number("time_limit_secs", self.time_limit_secs, (LEAST_SECS, limits.secs))?;
        let is_open = samples.is_none() && max_error.is_none() && secs.is_none();
        Ok(StopRules {
            samples: if is_open { Some(DEFAULT_SAMPLES) } else { samples },
            max_error,
            time_limit: secs.map(Duration::from_secs_f64),
        })
    }

    fn aov(&self, catalogue: &Catalogue, technique: &str) -> Result<Option<&'static str>, Fault> {
        let Some(name) = &self.aov else { return Ok(None) };
        let Some((output, owner)) = catalogue.output(name) else {
            let ids: Vec<&str> = catalogue.outputs().map(|(output, _)| output.id).collect();
            return Err(Fault::value("aov", format!("must be one of {}", ids.join(", "))));
        };
        match owner.filter(|owner| owner.id != technique) {
            Some(owner) => {
                let reason = format!("technique {technique} has no {}; {} has", output.id, owner.id);
                Err(Fault::value("aov", reason))
            }
            None => Ok(Some(output.id)),
        }
    }
}

fn whole(field: &str, value: Option<Whole>, low: u64, high: u64) -> Result<Option<u64>, Fault> {
    let Some(Whole(number)) = value else { return Ok(None) };
    match u64::try_from(number) {
        Ok(number) if number >= low && number <= high => Ok(Some(number)),
        _ => Err(Fault::value(field, format!("must be within {low} to {high}"))),
    }
}

fn number(field: &str, value: Option<f64>, (low, high): (f64, f64)) -> Result<Option<f64>, Fault> {
    value.map(|value| within(field, value, low, high)).transpose()
}

fn camera_of(request: &CameraRequest) -> Result<Camera, Fault> {
    let missing = |name: &str| Fault::malformed(format!("camera.{name}"), "missing");
    let position = request.position.ok_or_else(|| missing("position"))?;
    let target = request.target.ok_or_else(|| missing("target"))?;
    let vfov_deg = request.vfov_deg.ok_or_else(|| missing("vfov_deg"))?;
    let up = request.up.unwrap_or([0.0, 1.0, 0.0]);
    camera("camera", "position", [position, target, up], vfov_deg)
}

/// A camera as data. The field of view stays in radians: degrees would not come back to the bit.
#[derive(Serialize, Deserialize)]
struct CameraData {
    position: [f64; 3],
    target: [f64; 3],
    up: [f64; 3],
    vfov: f64,
}

fn write_camera<S: Serializer>(camera: &Camera, serializer: S) -> Result<S::Ok, S::Error> {
    let [position, target, up] = [camera.position, camera.target, camera.up].map(|vector| vector.to_array());
    CameraData { position, target, up, vfov: camera.vfov }.serialize(serializer)
}

fn read_camera<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Camera, D::Error> {
    let CameraData { position, target, up, vfov } = CameraData::deserialize(deserializer)?;
    let [position, target, up] = [position, target, up].map(DVec3::from_array);
    Ok(Camera { position, target, up, vfov })
}
