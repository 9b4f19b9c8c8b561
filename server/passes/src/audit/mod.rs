//! The error audit: how far the shown image is from the truth, bias included.
//!
//! For a sparse random set of pixels independent unbiased estimates are drawn, in streams that share no random number.
//! The streams are split into halves a and b. With t the tone map of the metric, `(t(x) - t(a)) (t(x) - t(b))` has the
//! squared error of the shown value x as its expectation, since the noise of a and b is independent and cancels.
//! `estimate.rs` keeps this true although the tone map is non-linear.
//!
//! A few pixels (edges of lamps, caustics) may carry most of the error, and a sparse set misses most of them. So each
//! pixel's error is also *predicted* from its sample variance, which costs no ray, over the whole image; the
//! audited pixels then correct the prediction: `mean(all predicted) + mean(audited - predicted)`. That is unbiased
//! however poor the prediction is, and its noise is that of the correction alone.
//!
//! The pixels are stratified (`pixels.rs`). Audit samples never enter the image.

mod estimate;
mod pixels;

use surfelcast_gpu::{Buffer, Gpu, GpuError, Kernel, MemoryKind, PassTime};
use surfelcast_render_api::ErrorEstimate;
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::AuditUniforms;

use crate::audit::estimate::{Evidence, STREAMS, evaluate};
use crate::audit::pixels::{AuditPixel, audit_pixels};
use crate::counters;
use crate::frame::FrameView;
use crate::lights::LightBuffers;
use crate::upload::SceneBuffers;

/// Threads that share one half's samples.
const LANES: u32 = STREAMS as u32 / 2;
/// Paths of one submission, so that none holds the device for long.
const MAX_PATHS: u32 = 1 << 16;
/// Samples of each half over the samples per pixel of the image: for an image whose error is the noise of its samples,
/// no other share gives a more accurate estimate at as many rays.
const SAMPLE_SHARE: f32 = 0.5;
/// Keeps the audit's random numbers apart from those of the image.
const SEED_SALT: u64 = 0x5af3_17c9_b0d2_6e41;

/// Audit of one image, as long as camera and lights do not change.
#[derive(Debug)]
pub struct Audit {
    pixels: Vec<AuditPixel>,
    features: Features,
    kernel: Kernel,
    gather: Kernel,
    predict: Kernel,
    pixel_list: Buffer,
    lane_means: Buffer,
    image_values: Buffer,
    predicted_sums: Buffer,
    counters: Buffer,
    lane_samples: u32,
    seed: u64,
}

/// What an audit found.
#[derive(Clone, Debug, Default)]
pub struct AuditResult {
    /// Mean squared error after the tone map. Unbiased, and so negative by chance where the error is below the noise of
    /// the audit.
    pub mse: f64,
    /// Standard error of `mse`.
    pub mse_std_error: f64,
    /// RMSE after the tone map: the root of `mse`, 0 where that is negative.
    pub rmse_tonemapped: f64,
    /// Standard error of `rmse_tonemapped`.
    pub std_error: f64,
    /// Ends of the interval that contains the true RMSE in nine cases of ten.
    pub rmse_interval: [f64; 2],
    /// Bound that the error is very probably below: the upper end of the interval, and at least the prediction from the
    /// sample variance. A render to an error goal stops on it: the render is audited many times and ends at the first
    /// audit that passes, which is likely to be one that is low by chance.
    pub bound: f64,
    /// Mean squared error relative to `r^2 + 0.01 mean(r)^2`.
    pub rel_mse: f64,
    /// Rays: primary, secondary, shadow.
    pub rays: [u64; 3],
    /// Samples that were not finite.
    pub non_finite: u64,
    /// Passes with their times.
    pub passes: Vec<PassTime>,
}

impl From<&AuditResult> for ErrorEstimate {
    fn from(audit: &AuditResult) -> Self {
        let [low, high] = audit.rmse_interval;
        Self {
            rmse_tonemapped: audit.rmse_tonemapped as f32,
            rel_mse: audit.rel_mse as f32,
            std_error: audit.std_error as f32,
            rmse_low: low as f32,
            rmse_high: high as f32,
            mse_tonemapped: audit.mse as f32,
        }
    }
}

impl Audit {
    /// Whether the kernels are compiled, so that [`Audit::new`] does not wait. If not, starts to compile them in the
    /// background.
    pub fn is_ready(gpu: &Gpu, features: Features) -> bool {
        let is_ready = gpu.kernel_if_ready("error_audit", features).is_some();
        if !is_ready {
            gpu.prepare("error_audit", features);
        }
        is_ready
    }

    /// Prepares an audit of an image of this size.
    pub fn new(gpu: &Gpu, features: Features, size: [u32; 2], seed: u64) -> Result<Self, GpuError> {
        let pixels = audit_pixels(size, seed ^ SEED_SALT);
        let lanes = pixels.len() as u64 * STREAMS as u64;
        let pixel_list = gpu.buffer("audit_pixels", MemoryKind::View, pixels.len() as u64 * 4)?;
        let indices: Vec<u32> = pixels.iter().map(|pixel| pixel.index).collect();
        gpu.upload(&pixel_list, 0, bytemuck::cast_slice(&indices))?;
        Ok(Self {
            features,
            kernel: gpu.kernel("error_audit", features)?,
            gather: gpu.kernel("audit_gather", Features::NONE)?,
            predict: gpu.kernel("audit_predict", Features::NONE)?,
            pixel_list,
            lane_means: gpu.buffer("audit_means", MemoryKind::View, lanes * 16)?,
            image_values: gpu.buffer("audit_values", MemoryKind::View, pixels.len() as u64 * 16)?,
            predicted_sums: gpu.buffer("predicted_sums", MemoryKind::View, u64::from(predict_groups(size)) * 4)?,
            counters: counters::buffer(gpu)?,
            pixels,
            lane_samples: 0,
            seed,
        })
    }

    /// Forgets all samples: camera or lights changed.
    pub fn reset(&mut self) {
        self.lane_samples = 0;
    }

    /// Audits the image, after taking as many audit samples as its sample count requires.
    #[allow(clippy::too_many_arguments, reason = "the image, its scene and its view are separate owners")]
    pub fn run(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        image: &Buffer,
        samples: u32,
        exposure: f32,
    ) -> Result<AuditResult, GpuError> {
        let mut result = AuditResult::default();
        let wanted = ((samples as f32 * SAMPLE_SHARE / LANES as f32).ceil() as u32).max(1);
        while self.lane_samples < wanted {
            let count = (wanted - self.lane_samples).min((MAX_PATHS / (self.pixels.len() * STREAMS) as u32).max(1));
            self.sample(gpu, scene, lights, view, count, &mut result)?;
        }
        let count = self.pixels.len() as u32;
        let uniforms = |pixel_count| AuditUniforms { pixel_count, samples: samples as f32, exposure, padding: 0 };
        let mut graph = gpu.graph("audit");
        graph
            .pass(&self.gather)
            .uniform("audit", bytemuck::bytes_of(&uniforms(count)))
            .bind("accumulation", image)
            .bind("audit_pixels", &self.pixel_list)
            .bind("audit_values", &self.image_values)
            .dispatch([count.div_ceil(64), 1, 1])?;
        let pixel_count = view.size[0] * view.size[1];
        graph
            .pass(&self.predict)
            .uniform("audit", bytemuck::bytes_of(&uniforms(pixel_count)))
            .bind("accumulation", image)
            .bind("predicted_sums", &self.predicted_sums)
            .dispatch([predict_groups(view.size), 1, 1])?;
        let values = graph.read_back(&self.image_values, 0..self.image_values.size_bytes())?;
        let means = graph.read_back(&self.lane_means, 0..self.lane_means.size_bytes())?;
        let sums = graph.read_back(&self.predicted_sums, 0..self.predicted_sums.size_bytes())?;
        let mut report = graph.submit()?.wait()?;
        let values: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&report.take(values)?);
        let means: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&report.take(means)?);
        let sums: Vec<f32> = bytemuck::pod_collect_to_vec(&report.take(sums)?);
        crate::merge_passes(&mut result.passes, report.passes);
        let predicted = sums.iter().map(|&sum| f64::from(sum)).sum::<f64>() / f64::from(pixel_count);
        let evidence = Evidence { pixels: &self.pixels, values: &values, means: &means, predicted, exposure };
        evaluate(&evidence, &mut result);
        Ok(result)
    }

    fn sample(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        count: u32,
        result: &mut AuditResult,
    ) -> Result<(), GpuError> {
        let lanes = (self.pixels.len() * STREAMS) as u32;
        let mut uniforms = view.uniforms(scene, lights, self.features, self.seed ^ SEED_SALT);
        uniforms.pixel_count = lanes;
        uniforms.first_sample = self.lane_samples;
        uniforms.sample_count = count;
        uniforms.selector = LANES;
        let mut graph = gpu.graph("error_audit");
        graph.clear(&self.counters)?;
        lights
            .bind(scene.bind(graph.pass(&self.kernel)))
            .uniform("frame", bytemuck::bytes_of(&uniforms))
            .bind("audit_pixels", &self.pixel_list)
            .bind("audit_means", &self.lane_means)
            .bind("counters", &self.counters)
            .dispatch([lanes.div_ceil(64), 1, 1])?;
        let ticket = graph.read_back(&self.counters, 0..counters::BYTES)?;
        let mut report = graph.submit()?.wait()?;
        let counts = counters::sum(&report.take(ticket)?);
        for (sum, counted) in result.rays.iter_mut().zip(counts.rays) {
            *sum += counted;
        }
        result.non_finite += counts.non_finite;
        self.lane_samples += count;
        crate::merge_passes(&mut result.passes, report.passes);
        Ok(())
    }
}

/// Workgroups of `audit_predict`: 64 threads of 16 pixels.
fn predict_groups(size: [u32; 2]) -> u32 {
    (size[0] * size[1]).div_ceil(64 * 16)
}
