//! The body of `POST /v1/renders`, checked field by field.
//!
//! Read by hand rather than by derive, so that every refusal names its field, and unknown fields are refused instead of
//! silently giving another picture than the one asked for.

use std::sync::Arc;
use std::time::Duration;

use serde_json::{Map, Value};
use sha2::{Digest, Sha256};
use surfelcast_protocol::settings::Pose;
use surfelcast_renderer::scene::{Camera, Scene};
use surfelcast_renderer::{Aov, DEFAULT_TECHNIQUE, MaterialMode, RenderJob, RendererStatus, StopRules, SurfelSettings};
use surfelcast_review::number::{EXPOSURE, within};

use crate::camera::camera;
use crate::config::Bounds;
use crate::http::problem::ApiError;
use crate::http::surfel_request::surfel_settings;

/// Samples a pixel of a render that names no stop rule.
const DEFAULT_SAMPLES: u32 = 64;
/// Size of a render that names none, where the camera names none either.
const DEFAULT_SIZE: [u32; 2] = [1280, 720];
/// Fields of the body.
const FIELDS: [&str; 17] = [
    "scene",
    "camera",
    "camera_name",
    "width",
    "height",
    "technique",
    "preset",
    "surfel",
    "reconstruction",
    "samples_per_pixel",
    "frames",
    "max_error",
    "time_limit_secs",
    "seed",
    "materials",
    "exposure",
    "aov",
];
const CAMERA_FIELDS: [&str; 4] = ["position", "target", "up", "vfov_deg"];

/// A body that is well formed and within the bounds, before the scene is known.
#[derive(Clone, Debug)]
pub(crate) struct RenderSpec {
    pub(crate) scene: String,
    camera: Option<Camera>,
    camera_name: Option<String>,
    width: Option<u32>,
    height: Option<u32>,
    technique: Option<String>,
    surfel: SurfelSettings,
    /// A field that only techniques with surfels heed.
    needs_surfels: Option<&'static str>,
    stop: StopRules,
    seed: u64,
    materials: MaterialMode,
    exposure: Option<f32>,
    aov: Option<Aov>,
}

/// A job with its cache key.
#[derive(Clone, Debug)]
pub(crate) struct ResolvedRender {
    pub(crate) job: RenderJob,
    /// Hash over everything the picture depends on.
    pub(crate) key: String,
}

impl RenderSpec {
    /// Reads the body. 400 for what is not well formed, 422 for values that cannot be.
    pub(crate) fn parse(body: &[u8], bounds: &Bounds) -> Result<Self, ApiError> {
        let value: Value =
            serde_json::from_slice(body).map_err(|e| ApiError::bad_request(format!("body: not JSON: {e}")))?;
        let Value::Object(map) = value else { return Err(ApiError::bad_request("body: expected a JSON object")) };
        let fields = Fields::new(&map, "", &FIELDS)?;
        let spec = Self {
            scene: fields.string("scene")?.ok_or_else(|| {
                ApiError::bad_request("scene: missing; it is the id of a scene that GET /v1/scenes lists")
            })?,
            camera: map.get("camera").map(parse_camera).transpose()?,
            camera_name: fields.string("camera_name")?,
            width: fields.integer("width", 1, u64::from(bounds.render_side))?.map(|v| v as u32),
            height: fields.integer("height", 1, u64::from(bounds.render_side))?.map(|v| v as u32),
            technique: fields.string("technique")?,
            surfel: surfel_settings(
                fields.string("preset")?.as_deref(),
                fields.string("reconstruction")?.as_deref(),
                fields.get("surfel"),
            )?,
            needs_surfels: field_for_surfels(&fields)?,
            stop: parse_stop(&fields, bounds)?,
            seed: fields.integer("seed", 0, u64::MAX)?.unwrap_or(0),
            materials: match fields.string("materials")?.as_deref() {
                None | Some("pbr") => MaterialMode::Pbr,
                Some("lambert") => MaterialMode::Lambert,
                Some(_) => return Err(ApiError::unprocessable("materials: must be pbr or lambert")),
            },
            exposure: match fields.number("exposure")? {
                Some(value) => {
                    let checked = within("exposure", value, f64::from(EXPOSURE.0), f64::from(EXPOSURE.1));
                    Some(checked.map_err(ApiError::unprocessable)? as f32)
                }
                None => None,
            },
            aov: match fields.string("aov")? {
                Some(name) => Some(Aov::by_name(&name).ok_or_else(|| {
                    let names: Vec<&str> = Aov::ALL.iter().map(|(name, _)| *name).collect();
                    ApiError::unprocessable(format!("aov: must be one of {}", names.join(", ")))
                })?),
                None => None,
            },
        };
        if spec.camera.is_some() && spec.camera_name.is_some() {
            return Err(ApiError::unprocessable("camera, camera_name: only one of the two may be given"));
        }
        Ok(spec)
    }

    /// Fills in what depends on the scene and the renderer.
    pub(crate) fn resolve(
        &self,
        scene: Arc<Scene>,
        status: &RendererStatus,
        bounds: &Bounds,
        server: &str,
    ) -> Result<ResolvedRender, ApiError> {
        let named = match &self.camera_name {
            Some(name) => Some(scene.camera(name).ok_or_else(|| {
                let names: Vec<&str> = scene.cameras.iter().take(32).map(|c| c.name.as_str()).collect();
                ApiError::unprocessable(format!(
                    "camera_name: the scene has no such camera; it has {}",
                    names.join(", ")
                ))
            })?),
            None if self.camera.is_some() => None,
            None => scene.cameras.first(),
        };
        let camera = self
            .camera
            .or(named.map(|named| named.camera))
            .ok_or_else(|| ApiError::unprocessable("camera: missing, and the scene has none"))?;
        let authored = named.and_then(|named| named.resolution).unwrap_or(DEFAULT_SIZE);
        let size = match (self.width, self.height) {
            (Some(width), Some(height)) => [width, height],
            (None, None) => authored,
            _ => return Err(ApiError::unprocessable("width, height: give both or none")),
        };
        if u64::from(size[0]) * u64::from(size[1]) > bounds.render_pixels {
            let detail = format!("width x height: more than the limit of {} pixels", bounds.render_pixels);
            return Err(ApiError::unprocessable(detail));
        }
        let technique = self.technique.as_deref().unwrap_or(DEFAULT_TECHNIQUE);
        let Some(known) = status.techniques.iter().find(|known| known.id == technique) else {
            let ids: Vec<&str> = status.techniques.iter().map(|technique| technique.id).collect();
            return Err(ApiError::unprocessable(format!("technique: must be one of {}", ids.join(", "))));
        };
        if let Some(field) = self.needs_surfels.filter(|_| !known.uses_surfels) {
            return Err(ApiError::unprocessable(format!(
                "{field}: technique {technique} has no surfels; leave the field out, or ask for one that has"
            )));
        }
        let exposure = self.exposure.unwrap_or_else(|| named.map_or(1.0, |named| scene.exposure_for(&named.name)));
        let job = RenderJob {
            lights: None,
            camera,
            size,
            technique: technique.to_owned(),
            materials: self.materials,
            surfel: self.surfel,
            seed: self.seed,
            stop: self.stop,
            exposure,
            aov: self.aov,
            exports_surfels: false,
            scene,
        };
        let key = cache_key(&job, status, server);
        Ok(ResolvedRender { job, key })
    }
}

/// Everything a picture depends on: request, scene, program and device.
fn cache_key(job: &RenderJob, status: &RendererStatus, server: &str) -> String {
    let mut hash = Sha256::new();
    let mut add = |field: &str, value: &dyn std::fmt::Debug| hash.update(format!("{field}={value:?}\n"));
    add("server", &server);
    add("device", &status.device);
    add("scene", &job.scene.key().to_string());
    let numbers = [job.camera.position, job.camera.target, job.camera.up].map(|v| v.to_array().map(f64::to_bits));
    add("camera", &(numbers, job.camera.vfov.to_bits()));
    add("size", &job.size);
    add("technique", &job.technique);
    add("materials", &job.materials);
    add("surfel", &job.surfel);
    add("seed", &job.seed);
    add("stop", &(job.stop.samples, job.stop.max_error.map(f32::to_bits), job.stop.time_limit));
    add("exposure", &job.exposure.to_bits());
    add("aov", &job.aov);
    hex::encode(hash.finalize())
}

fn parse_stop(fields: &Fields<'_>, bounds: &Bounds) -> Result<StopRules, ApiError> {
    let limit = u64::from(bounds.render_samples);
    let samples = fields.integer("samples_per_pixel", 1, limit)?;
    // A progressive technique adds one sample a pixel and frame, so the two count the same thing.
    let frames = fields.integer("frames", 1, limit)?;
    if samples.is_some() && frames.is_some() {
        return Err(ApiError::unprocessable("samples_per_pixel, frames: only one of the two may be given"));
    }
    let max_error = match fields.number("max_error")? {
        Some(value) => Some(within("max_error", value, 1e-6, 1.0).map_err(ApiError::unprocessable)? as f32),
        None => None,
    };
    let time_limit = match fields.number("time_limit_secs")? {
        Some(value) => {
            let secs = within("time_limit_secs", value, 0.001, bounds.render_secs).map_err(ApiError::unprocessable)?;
            Some(Duration::from_secs_f64(secs))
        }
        None => None,
    };
    let samples = samples.or(frames).map(|v| v as u32);
    let is_open = samples.is_none() && max_error.is_none() && time_limit.is_none();
    Ok(StopRules { samples: if is_open { Some(DEFAULT_SAMPLES) } else { samples }, max_error, time_limit })
}

fn parse_camera(value: &Value) -> Result<Camera, ApiError> {
    let Value::Object(map) = value else { return Err(ApiError::bad_request("camera: expected an object")) };
    let fields = Fields::new(map, "camera.", &CAMERA_FIELDS)?;
    let need = |name: &str| ApiError::bad_request(format!("camera.{name}: missing"));
    let pose = Pose {
        eye: fields.vector("position")?.ok_or_else(|| need("position"))?,
        target: fields.vector("target")?.ok_or_else(|| need("target"))?,
        up: fields.vector("up")?.unwrap_or([0.0, 1.0, 0.0]),
        vfov_deg: fields.number("vfov_deg")?.ok_or_else(|| need("vfov_deg"))?,
    };
    camera("camera", "position", &pose).map_err(ApiError::unprocessable)
}

/// Typed access to the fields of an object.
struct Fields<'a> {
    map: &'a Map<String, Value>,
    prefix: &'a str,
}

impl<'a> Fields<'a> {
    fn new(map: &'a Map<String, Value>, prefix: &'a str, known: &[&str]) -> Result<Self, ApiError> {
        if let Some(name) = map.keys().find(|name| !known.contains(&name.as_str())) {
            let name: String = name.chars().take(64).collect();
            let detail = format!("{prefix}{name}: unknown field; known are {}", known.join(", "));
            return Err(ApiError::bad_request(detail));
        }
        Ok(Self { map, prefix })
    }

    fn get(&self, name: &str) -> Option<&'a Value> {
        self.map.get(name).filter(|value| !value.is_null())
    }

    fn wrong(&self, name: &str, expected: &str) -> ApiError {
        ApiError::bad_request(format!("{}{name}: expected {expected}", self.prefix))
    }

    fn string(&self, name: &str) -> Result<Option<String>, ApiError> {
        self.get(name).map(|v| v.as_str().map(str::to_owned).ok_or_else(|| self.wrong(name, "a string"))).transpose()
    }

    fn number(&self, name: &str) -> Result<Option<f64>, ApiError> {
        self.get(name).map(|v| v.as_f64().ok_or_else(|| self.wrong(name, "a number"))).transpose()
    }

    fn integer(&self, name: &str, low: u64, high: u64) -> Result<Option<u64>, ApiError> {
        let Some(value) = self.get(name) else { return Ok(None) };
        let number = match value.as_u64() {
            Some(number) => number,
            // Negative whole numbers are well formed, merely out of range.
            None if value.as_i64().is_some() => 0,
            None => return Err(self.wrong(name, "a whole number")),
        };
        if value.as_i64().is_some_and(|v| v < 0) || number < low || number > high {
            let detail = format!("{}{name}: must be within {low} to {high}", self.prefix);
            return Err(ApiError::unprocessable(detail));
        }
        Ok(Some(number))
    }

    fn vector(&self, name: &str) -> Result<Option<[f64; 3]>, ApiError> {
        let Some(value) = self.get(name) else { return Ok(None) };
        let numbers: Option<Vec<f64>> = value.as_array().map(|items| items.iter().map_while(Value::as_f64).collect());
        let array = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
        // `map_while` cuts at the first value that is no number, so a longer list with rubbish behind is caught here.
        let is_whole = value.as_array().is_some_and(|items| items.len() == 3);
        array.filter(|_| is_whole).map(Some).ok_or_else(|| self.wrong(name, "three numbers"))
    }
}

/// Finds a field that means something to techniques with surfels only.
fn field_for_surfels(fields: &Fields<'_>) -> Result<Option<&'static str>, ApiError> {
    let is_given = |name| fields.get(name).is_some_and(|value| value.as_object().is_none_or(|knobs| !knobs.is_empty()));
    Ok(match fields.string("reconstruction")?.as_deref() {
        Some(name) if name != "none" => Some("reconstruction"),
        _ => ["preset", "surfel"].into_iter().find(|name| is_given(name)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(body: &str) -> (u16, String) {
        let error = RenderSpec::parse(body.as_bytes(), &Bounds::default()).expect_err(body);
        (error.status().as_u16(), error.detail().to_owned())
    }

    #[test]
    fn refusals_name_the_field() {
        let cases = [
            ("{", 400, "body"),
            ("[]", 400, "body"),
            ("{}", 400, "scene"),
            (r#"{"scene":"s","spp":4}"#, 400, "spp"),
            (r#"{"scene":"s","name":"x"}"#, 400, "name"),
            (r#"{"scene":"s","width":"9"}"#, 400, "width"),
            (r#"{"scene":"s","width":0}"#, 422, "width"),
            (r#"{"scene":"s","width":-5}"#, 422, "width"),
            (r#"{"scene":"s","width":1.5}"#, 400, "width"),
            (r#"{"scene":"s","height":99999}"#, 422, "height"),
            (r#"{"scene":"s","seed":-1}"#, 422, "seed"),
            (r#"{"scene":"s","samples_per_pixel":0}"#, 422, "samples_per_pixel"),
            (r#"{"scene":"s","samples_per_pixel":1,"frames":1}"#, 422, "samples_per_pixel"),
            (r#"{"scene":"s","max_error":2}"#, 422, "max_error"),
            (r#"{"scene":"s","max_error":1e999}"#, 400, "body"),
            (r#"{"scene":"s","time_limit_secs":0}"#, 422, "time_limit_secs"),
            (r#"{"scene":"s","materials":"wood"}"#, 422, "materials"),
            (r#"{"scene":"s","exposure":0}"#, 422, "exposure"),
            (r#"{"scene":"s","aov":"soul"}"#, 422, "aov"),
            (r#"{"scene":"s","preset":"ultra"}"#, 422, "preset"),
            (r#"{"scene":"s","preset":3}"#, 400, "preset"),
            (r#"{"scene":"s","reconstruction":"best"}"#, 422, "reconstruction"),
            (r#"{"scene":"s","reconstruction":1}"#, 400, "reconstruction"),
            (r#"{"scene":"s","surfel":4}"#, 400, "surfel"),
            (r#"{"scene":"s","surfel":{"radius":"4"}}"#, 400, "surfel.radius"),
            (r#"{"scene":"s","surfel":{"radius":0.5}}"#, 422, "surfel.radius"),
            (r#"{"scene":"s","surfel":{"size":4}}"#, 422, "surfel.size"),
            (r#"{"scene":"s","camera":7}"#, 400, "camera"),
            (r#"{"scene":"s","camera":{"position":[0,0,1],"target":[0,0,0]}}"#, 400, "camera.vfov_deg"),
            (r#"{"scene":"s","camera":{"position":[0,0],"target":[0,0,0],"vfov_deg":40}}"#, 400, "camera.position"),
            (
                r#"{"scene":"s","camera":{"position":[0,0,1,"x"],"target":[0,0,0],"vfov_deg":40}}"#,
                400,
                "camera.position",
            ),
            (
                r#"{"scene":"s","camera":{"position":[0,0,1e300],"target":[0,0,0],"vfov_deg":40}}"#,
                422,
                "camera.position",
            ),
            (r#"{"scene":"s","camera":{"position":[0,0,1],"target":[0,0,0],"vfov_deg":400}}"#, 422, "camera.vfov_deg"),
            (
                r#"{"scene":"s","camera":{"position":[0,0,1],"target":[0,0,0],"vfov_deg":40,"fov":1}}"#,
                400,
                "camera.fov",
            ),
        ];
        for (body, status, field) in cases {
            let (code, detail) = refused(body);
            assert_eq!(code, status, "{body}: {detail}");
            assert!(detail.starts_with(field), "{body}: {detail}");
        }
    }

    #[test]
    fn every_output_can_be_asked_for() {
        for (name, aov) in Aov::ALL {
            let body = format!(r#"{{"scene":"s","aov":"{name}"}}"#);
            assert_eq!(RenderSpec::parse(body.as_bytes(), &Bounds::default()).expect(name).aov, Some(aov));
        }
        let (_, detail) = refused(r#"{"scene":"s","aov":"soul"}"#);
        assert!(Aov::ALL.iter().all(|(name, _)| detail.contains(name)), "{detail}");
    }

    #[test]
    fn stop_rules_default_only_when_none_is_given() {
        let stop = |body: &str| RenderSpec::parse(body.as_bytes(), &Bounds::default()).expect(body).stop;
        assert_eq!(stop(r#"{"scene":"s"}"#).samples, Some(DEFAULT_SAMPLES));
        let by_error = stop(r#"{"scene":"s","max_error":0.01}"#);
        assert_eq!((by_error.samples, by_error.max_error), (None, Some(0.01)));
        assert_eq!(stop(r#"{"scene":"s","frames":9}"#).samples, Some(9));
        assert_eq!(stop(r#"{"scene":"s","time_limit_secs":2.5}"#).time_limit, Some(Duration::from_millis(2500)));
    }
}
