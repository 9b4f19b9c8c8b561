//! Settings of a view: what a client wants to see. They outlive its connection.

use surfelcast_protocol::client::ViewSet;
use surfelcast_protocol::limits::Limits;
use surfelcast_protocol::settings::Codec;
use surfelcast_renderer::scene::{Camera, Scene};
use surfelcast_renderer::{Catalogue, Settings, ViewState};
use surfelcast_review::ReviewError;
use surfelcast_review::number::{EXPOSURE, view_size, within};
use surfelcast_stream::QualityLimits;

use crate::live::outputs::live_by_name;

/// Size of a view whose client has not stated one.
const DEFAULT_SIZE: [u32; 2] = [1280, 720];
/// Refinement ends at this tone-mapped RMSE unless the client sets another: just under one 8-bit step.
const DEFAULT_MAX_ERROR: f32 = 0.003;
/// Refinement ends at this many samples a pixel unless the client sets another number.
const DEFAULT_MAX_SAMPLES: u32 = 4096;
/// Largest number of samples a pixel that a client may set.
const MAX_SAMPLES: u32 = 1 << 20;

/// Settings of one view.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ViewSettings {
    pub(crate) camera: Camera,
    pub(crate) size: [u32; 2],
    pub(crate) exposure: f32,
    pub(crate) technique: String,
    /// Shown instead of radiance.
    pub(crate) aov: Option<&'static str>,
    pub(crate) max_error: f32,
    pub(crate) max_samples: u32,
    pub(crate) quality: QualityLimits,
    pub(crate) codec: Option<Codec>,
    pub(crate) is_paused: bool,
}

impl Default for ViewSettings {
    fn default() -> Self {
        let camera = Camera {
            position: glam::DVec3::Z,
            target: glam::DVec3::ZERO,
            up: glam::DVec3::Y,
            vfov: std::f64::consts::FRAC_PI_4,
        };
        Self {
            camera,
            size: DEFAULT_SIZE,
            exposure: 1.0,
            technique: String::new(),
            aov: None,
            max_error: DEFAULT_MAX_ERROR,
            max_samples: DEFAULT_MAX_SAMPLES,
            quality: QualityLimits::default(),
            codec: None,
            is_paused: false,
        }
    }
}

impl ViewSettings {
    /// The scene's first camera, at a default size, with the default technique.
    pub(crate) fn of_scene(scene: &Scene, technique: &str, max_pixels: u64) -> Self {
        let mut settings = Self { technique: technique.to_owned(), ..Self::default() };
        if let Some(named) = scene.cameras.first() {
            settings.camera = named.camera;
            settings.exposure = scene.exposure_for(&named.name).clamp(EXPOSURE.0, EXPOSURE.1);
        }
        while u64::from(settings.size[0]) * u64::from(settings.size[1]) > max_pixels.max(1) {
            settings.size = settings.size.map(|side| (side / 2).max(1));
        }
        settings
    }

    /// Applies a client's changes, all of them or none.
    pub(crate) fn apply(
        &mut self,
        set: &ViewSet,
        limits: &Limits,
        catalogue: &Catalogue,
        offered: &[Codec],
    ) -> Result<(), ReviewError> {
        let mut next = self.clone();
        next.size = view_size([set.w.unwrap_or(next.size[0]), set.h.unwrap_or(next.size[1])], limits)?;
        if let Some(quality) = set.min_q {
            next.quality.min_quality = within("min_q", quality, 1, 100)?;
        }
        if let Some(quality) = set.max_q {
            next.quality.max_quality = within("max_q", quality, 1, 100)?;
        }
        if next.quality.min_quality > next.quality.max_quality {
            return Err(ReviewError::invalid("min_q", "must not be above max_q"));
        }
        if let Some(fps) = set.fps {
            next.quality.frames_per_sec = within("fps", fps, 1, 120)?;
        }
        if let Some(codec) = set.codec {
            if !offered.contains(&codec) {
                return Err(ReviewError::invalid("codec", "not among the codecs offered in hello"));
            }
            next.codec = Some(codec);
        }
        if let Some(paused) = set.paused {
            next.is_paused = paused;
        }
        if let Some(exposure) = set.exposure {
            next.exposure = within("exposure", exposure, EXPOSURE.0, EXPOSURE.1)?;
        }
        if let Some(technique) = &set.technique {
            if catalogue.choose(technique).is_none() {
                let ids: Vec<&str> = catalogue.technique_ids().map(|(id, ..)| id).collect();
                return Err(ReviewError::invalid("technique", format!("must be one of {}", ids.join(", "))));
            }
            next.technique.clone_from(technique);
        }
        if let Some(output) = &set.aov {
            next.aov = output.as_deref().map(|name| live_by_name(catalogue, "aov", name)).transpose()?;
        }
        if let Some(error) = set.max_error {
            next.max_error = within("max_error", error, f32::MIN_POSITIVE, 1.0)?;
        }
        if let Some(samples) = set.max_spp {
            next.max_samples = within("max_spp", samples, 1, MAX_SAMPLES)?;
        }
        *self = next;
        Ok(())
    }

    /// The state that the renderer works from.
    pub(crate) fn view_state(&self, is_moving: bool, scale: f32, frames_per_sec: f32, input_seq: u32) -> ViewState {
        ViewState {
            camera: self.camera,
            size: self.size,
            exposure: self.exposure,
            technique: self.technique.clone(),
            settings: Settings::default(),
            aov: self.aov.map(str::to_owned),
            is_moving,
            is_paused: self.is_paused,
            max_scale: scale,
            target_frame_secs: 1.0 / frames_per_sec.max(1.0),
            max_error: self.max_error,
            max_samples: self.max_samples,
            input_seq,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_catalogue::catalogue;

    fn apply(set: &ViewSet) -> Result<ViewSettings, ReviewError> {
        let mut settings = ViewSettings::default();
        settings.apply(set, &Limits::default(), &catalogue(), &[Codec::Jpeg])?;
        Ok(settings)
    }

    #[test]
    fn absent_fields_stay() {
        let set = ViewSet { w: Some(640), fps: Some(60), ..ViewSet::default() };
        let settings = apply(&set).expect("valid");
        assert_eq!((settings.size, settings.quality.frames_per_sec), ([640, 720], 60));
        assert_eq!(
            ViewSettings { size: DEFAULT_SIZE, quality: QualityLimits::default(), ..settings },
            ViewSettings::default()
        );
    }

    #[test]
    fn outputs_come_and_go() {
        let mut settings = ViewSettings::default();
        let mut set_output = |aov: Option<Option<&str>>| {
            let set = ViewSet { aov: aov.map(|name| name.map(str::to_owned)), ..ViewSet::default() };
            settings.apply(&set, &Limits::default(), &catalogue(), &[]).expect("valid");
            settings.view_state(false, 1.0, 30.0, 0).aov.unwrap_or_default()
        };
        assert_eq!(set_output(None), "");
        assert_eq!(set_output(Some(Some("depth"))), "depth");
        assert_eq!(set_output(None), "depth", "absent fields stay");
        assert_eq!(set_output(Some(None)), "", "null goes back to radiance");
        for output in crate::live::outputs::offered(&catalogue()) {
            assert_eq!(set_output(Some(Some(&output.id))), output.id);
        }
    }

    #[test]
    fn each_field_is_checked_by_name() {
        let base = ViewSet::default;
        let bad = [
            (ViewSet { w: Some(0), ..base() }, "w"),
            (ViewSet { h: Some(5000), ..base() }, "h"),
            (ViewSet { min_q: Some(0), ..base() }, "min_q"),
            (ViewSet { max_q: Some(101), ..base() }, "max_q"),
            (ViewSet { min_q: Some(90), max_q: Some(50), ..base() }, "min_q"),
            (ViewSet { fps: Some(0), ..base() }, "fps"),
            (ViewSet { codec: Some(Codec::Webp), ..base() }, "codec"),
            (ViewSet { exposure: Some(f32::NAN), ..base() }, "exposure"),
            (ViewSet { exposure: Some(f32::INFINITY), ..base() }, "exposure"),
            (ViewSet { technique: Some("warp".into()), ..base() }, "technique"),
            (ViewSet { aov: Some(Some("soul".into())), ..base() }, "aov"),
            (ViewSet { aov: Some(Some("variance".into())), ..base() }, "aov"),
            (ViewSet { max_error: Some(0.0), ..base() }, "max_error"),
            (ViewSet { max_spp: Some(0), ..base() }, "max_spp"),
        ];
        for (set, field) in bad {
            let error = apply(&set).expect_err(field).to_string();
            assert!(error.starts_with(field), "{error}");
        }
    }
}
