//! The error audit: how far the shown picture is from the truth, bias included.
//!
//! For a sparse random set of pixels two independent unbiased estimates a and b are drawn. With t the tone map of the
//! metric, `(t(x) - t(a)) (t(x) - t(b))` has the squared error of the shown value x as its expectation, since the noise of
//! a and b is independent and cancels. (The tone map is bent, so means of few samples are off by the same second-order
//! amount in a, b and x; the lanes take enough samples that it does not show.)
//!
//! A few pixels (edges of lamps, caustics) may carry most of the error, and a sparse set misses most of them. So each
//! pixel's error is also *predicted* from the scatter of its samples, which costs no ray, over the whole picture; the
//! audited pixels then correct the prediction: `mean(all predicted) + mean(audited - predicted)`. That is unbiased whatever
//! the prediction is worth, and its noise is that of the correction alone.
//!
//! The pixels are stratified: the picture is cut into cells and one pixel is drawn in each. Audit samples never feed the
//! picture.

use surfelcast_gpu::{Buffer, Gpu, GpuError, Kernel, MemoryKind, PassTime};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::AuditUniforms;

use crate::passes::counters;
use crate::passes::frame::FrameView;
use crate::passes::lights::LightBuffers;
use crate::passes::upload::SceneBuffers;

/// Audited pixels at most.
const MAX_PIXELS: u32 = 1024;
/// Threads that share one half's samples.
const LANES: u32 = 8;
/// Samples of one lane in a dispatch, so that no submission holds the device for long.
const MAX_LANE_SAMPLES: u32 = 4;
/// Share of the picture's samples a pixel that each half takes.
const SAMPLE_SHARE: f32 = 0.5;
/// Keeps the audit's random numbers apart from the picture's.
const SEED_SALT: u64 = 0x5af3_17c9_b0d2_6e41;

/// Audit of one picture. Lives as long as camera and lights stand still.
#[derive(Debug)]
pub struct Audit {
    pixels: Vec<u32>,
    features: Features,
    kernel: Kernel,
    gather: Kernel,
    predict: Kernel,
    pixel_list: Buffer,
    lane_means: Buffer,
    picture_values: Buffer,
    predicted_sums: Buffer,
    counters: Buffer,
    lane_samples: u32,
    seed: u64,
}

/// What an audit found.
#[derive(Clone, Debug, Default)]
pub struct AuditResult {
    /// RMSE after the tone map.
    pub rmse_tonemapped: f64,
    /// Standard error of `rmse_tonemapped`.
    pub std_error: f64,
    /// What the error is probably below (one standard error above the audited mean square, and no less than the scatter
    /// of the samples predicts): what a render to a stated error stops on.
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

impl Audit {
    /// Whether the kernels are compiled, so that [`Audit::new`] does not wait. Asks for them in the background if not.
    pub fn is_ready(gpu: &Gpu, features: Features) -> bool {
        let is_ready = gpu.kernel_if_ready("error_audit", features).is_some();
        if !is_ready {
            gpu.prepare("error_audit", features);
        }
        is_ready
    }

    /// Prepares an audit of a picture of that size.
    pub fn new(gpu: &Gpu, features: Features, size: [u32; 2], seed: u64) -> Result<Self, GpuError> {
        let pixels = audit_pixels(size, seed ^ SEED_SALT);
        let lanes = pixels.len() as u64 * 2 * u64::from(LANES);
        let pixel_list = gpu.buffer("audit_pixels", MemoryKind::View, pixels.len() as u64 * 4)?;
        gpu.upload(&pixel_list, 0, bytemuck::cast_slice(&pixels))?;
        Ok(Self {
            features,
            kernel: gpu.kernel("error_audit", features)?,
            gather: gpu.kernel("audit_gather", Features::NONE)?,
            predict: gpu.kernel("audit_predict", Features::NONE)?,
            pixel_list,
            lane_means: gpu.buffer("audit_means", MemoryKind::View, lanes * 16)?,
            picture_values: gpu.buffer("audit_values", MemoryKind::View, pixels.len() as u64 * 16)?,
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

    /// Audits the picture as it stands, taking first as many audit samples as its sample count asks for.
    #[allow(clippy::too_many_arguments, reason = "the picture, its scene and its view are separate owners")]
    pub fn run(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        picture: &Buffer,
        samples: u32,
        exposure: f32,
    ) -> Result<AuditResult, GpuError> {
        let mut result = AuditResult::default();
        let wanted = ((samples as f32 * SAMPLE_SHARE / LANES as f32).ceil() as u32).max(1);
        while self.lane_samples < wanted {
            let count = (wanted - self.lane_samples).min(MAX_LANE_SAMPLES);
            self.sample(gpu, scene, lights, view, count, &mut result)?;
        }
        let count = self.pixels.len() as u32;
        let uniforms = |pixel_count| AuditUniforms { pixel_count, samples: samples as f32, exposure, padding: 0 };
        let mut graph = gpu.graph("audit");
        graph
            .pass(&self.gather)
            .uniform("audit", bytemuck::bytes_of(&uniforms(count)))
            .read("accumulation", picture)
            .read("audit_pixels", &self.pixel_list)
            .read_write("audit_values", &self.picture_values)
            .dispatch([count.div_ceil(64), 1, 1])?;
        let pixel_count = view.size[0] * view.size[1];
        graph
            .pass(&self.predict)
            .uniform("audit", bytemuck::bytes_of(&uniforms(pixel_count)))
            .read("accumulation", picture)
            .read_write("predicted_sums", &self.predicted_sums)
            .dispatch([predict_groups(view.size), 1, 1])?;
        let values = graph.read_back(&self.picture_values, 0..u64::from(count) * 16)?;
        let means = graph.read_back(&self.lane_means, 0..u64::from(count) * 2 * u64::from(LANES) * 16)?;
        let sums = graph.read_back(&self.predicted_sums, 0..u64::from(predict_groups(view.size)) * 4)?;
        let mut report = graph.submit()?.wait()?;
        let values: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&report.take(values)?);
        let means: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&report.take(means)?);
        let sums: Vec<f32> = bytemuck::pod_collect_to_vec(&report.take(sums)?);
        crate::passes::merge_passes(&mut result.passes, report.passes);
        let predicted = sums.iter().map(|&sum| f64::from(sum)).sum::<f64>() / f64::from(pixel_count);
        evaluate(&values, &means, predicted, exposure, &mut result);
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
        let lanes = self.pixels.len() as u32 * 2 * LANES;
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
            .read("audit_pixels", &self.pixel_list)
            .read_write("audit_means", &self.lane_means)
            .read_write("counters", &self.counters)
            .dispatch([lanes.div_ceil(64), 1, 1])?;
        let ticket = graph.read_back(&self.counters, 0..counters::BYTES)?;
        let mut report = graph.submit()?.wait()?;
        let counts = counters::sum(&report.take(ticket)?);
        for (sum, counted) in result.rays.iter_mut().zip(counts.rays) {
            *sum += counted;
        }
        result.non_finite += counts.non_finite;
        self.lane_samples += count;
        crate::passes::merge_passes(&mut result.passes, report.passes);
        Ok(())
    }
}

/// Workgroups of `audit_predict`: 64 threads of 16 pixels.
fn predict_groups(size: [u32; 2]) -> u32 {
    (size[0] * size[1]).div_ceil(64 * 16)
}

/// One random pixel in each cell of a grid over the picture, in row order.
fn audit_pixels(size: [u32; 2], seed: u64) -> Vec<u32> {
    let [width, height] = size.map(u64::from);
    let pixel_count = width * height;
    let wanted = (pixel_count / 32).clamp(pixel_count.min(256), u64::from(MAX_PIXELS)).max(1);
    let aspect = width as f64 / height as f64;
    let columns = ((wanted as f64 * aspect).sqrt().round() as u64).clamp(1, width);
    let rows = (wanted / columns).clamp(1, height);
    let mut state = seed | 1;
    let mut random = |below: u64| {
        // xorshift64*: the choice of pixels needs no better.
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        (state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) % below.max(1)
    };
    let mut pixels = Vec::with_capacity((columns * rows) as usize);
    for row in 0..rows {
        let (top, bottom) = (row * height / rows, (row + 1) * height / rows);
        for column in 0..columns {
            let (left, right) = (column * width / columns, (column + 1) * width / columns);
            let x = left + random(right - left);
            let y = top + random(bottom - top);
            pixels.push((y * width + x) as u32);
        }
    }
    pixels
}

fn tone_map(c: [f64; 3], exposure: f64) -> [f64; 3] {
    let e = c.map(|v| v * exposure);
    let scale = 1.0 / (1.0 + e[0].max(e[1]).max(e[2]).max(0.0));
    e.map(|v| v * scale)
}

/// Means over pixels in fixed order. `values` hold the picture and each pixel's predicted squared error, `predicted` the
/// mean of that prediction over the whole picture.
fn evaluate(values: &[[f32; 4]], means: &[[f32; 4]], predicted: f64, exposure: f32, result: &mut AuditResult) {
    let lanes = LANES as usize;
    let half_mean = |lane_means: &[[f32; 4]]| {
        let mut sum = [0.0f64; 3];
        for mean in lane_means {
            for (s, &m) in sum.iter_mut().zip(mean) {
                *s += f64::from(m);
            }
        }
        sum.map(|s| s / lane_means.len().max(1) as f64)
    };
    let exposure = f64::from(exposure);
    let pixels: Vec<_> = values
        .iter()
        .zip(means.chunks_exact(2 * lanes))
        .map(|(x, half)| {
            let [r, g, b, prediction] = x.map(f64::from);
            ([r, g, b], prediction, half_mean(&half[..lanes]), half_mean(&half[lanes..]))
        })
        .collect();
    let count = pixels.len().max(1) as f64;
    let mean_value = pixels.iter().flat_map(|(x, ..)| x).sum::<f64>() / (3.0 * count);
    let mut corrections = Vec::with_capacity(pixels.len());
    let mut relative = 0.0;
    for (x, prediction, a, b) in &pixels {
        let (tx, ta, tb) = (tone_map(*x, exposure), tone_map(*a, exposure), tone_map(*b, exposure));
        let square = (0..3).map(|i| (tx[i] - ta[i]) * (tx[i] - tb[i])).sum::<f64>() / 3.0;
        corrections.push(square - prediction);
        relative += (0..3)
            .map(|i| {
                let r = (2.0 * x[i] + a[i] + b[i]) * 0.25;
                (x[i] - a[i]) * (x[i] - b[i]) / (r * r + 0.01 * mean_value * mean_value + 1e-30)
            })
            .sum::<f64>()
            / 3.0;
    }
    let correction = corrections.iter().sum::<f64>() / count;
    let mse = predicted + correction;
    let variance = corrections.iter().map(|c| (c - correction).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    let mse_error = (variance / count).sqrt();
    // A mean of products may fall below 0 by chance where the error is smaller than the audit can see; then the
    // standard error is all that is known.
    result.rmse_tonemapped = mse.max(0.0).sqrt();
    result.std_error = if mse > mse_error { mse_error / (2.0 * mse.sqrt()) } else { mse_error.sqrt() };
    result.bound = (mse.max(0.0) + mse_error).max(predicted).sqrt();
    result.rel_mse = (relative / count).max(0.0);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_pixel_of_each_cell() {
        let pixels = audit_pixels([320, 180], 7);
        assert!((900..=1024).contains(&pixels.len()), "{}", pixels.len());
        let mut sorted = pixels.clone();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), pixels.len());
        assert_eq!(audit_pixels([1, 1], 3), [0]);
        assert!(audit_pixels([4096, 1], 3).iter().all(|&p| p < 4096));
    }

    #[test]
    fn independent_halves_see_bias_and_not_their_own_noise() {
        // x is off by 0.1 everywhere; halves scatter by 0.3 around the truth of 0.5.
        let mut state = 1u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (f64::from(state >> 8) / f64::from(1 << 24) - 0.5) * 0.02
        };
        let n = 4000;
        let values = vec![[0.6f32, 0.6, 0.6, 0.0]; n];
        let means: Vec<[f32; 4]> = (0..n * 2 * LANES as usize).map(|_| [(0.5 + noise()) as f32; 4]).collect();
        let mut result = AuditResult::default();
        evaluate(&values, &means, 0.0, 1.0, &mut result);
        let expected = 0.6 / 1.6 - 0.5 / 1.5;
        assert!((result.rmse_tonemapped - expected).abs() < 3.0 * result.std_error + 1e-4, "{result:?}");
    }
}
