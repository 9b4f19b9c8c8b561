//! The light table: path vertices choose a light to sample in proportion to its power.

use surfelcast_gpu::{Buffer, Gpu, GpuError, MemoryKind};
use surfelcast_scene::lights::AliasTable;
use surfelcast_scene::{Environment, EnvironmentMap, LightState, PunctualKind, PunctualLight, Scene};
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::{AliasEntry, PunctualRecord};

/// Share of the probability that is uniform over all lights, so that a light is still sampled next to a much brighter
/// one.
const UNIFORM_SHARE: f32 = 0.1;

/// Lights in device memory, one set for each session.
#[derive(Debug)]
pub struct LightBuffers {
    /// Emissive triangles in the table.
    pub triangle_count: u32,
    /// Punctual lights in the table.
    pub punctual_count: u32,
    /// 1 where the table ends with the environment image.
    pub environment_count: u32,
    /// Factor on emission.
    pub emission_scale: f32,
    /// Factor on the environment.
    pub environment_scale: f32,
    pub(crate) light_table: Buffer,
    pub(crate) punctual_lights: Buffer,
}

impl LightBuffers {
    /// Builds and uploads the table.
    pub fn new(gpu: &Gpu, scene: &Scene, state: &LightState) -> Result<Self, GpuError> {
        let punctual: Vec<PunctualRecord> = state.punctual.iter().map(punctual_record).collect();
        let (weights, environment_count) = light_weights(scene, state);
        let table = alias_entries(&weights);
        let table_bytes = (table.len().max(1) * size_of::<AliasEntry>()) as u64;
        let light_table = gpu.buffer("light_table", MemoryKind::Scene, table_bytes)?;
        let light_bytes = (punctual.len().max(1) * size_of::<PunctualRecord>()) as u64;
        let punctual_lights = gpu.buffer("punctual_lights", MemoryKind::Scene, light_bytes)?;
        let empty_entry = [AliasEntry::default()];
        let empty_light = [PunctualRecord::default()];
        let table_slice: &[AliasEntry] = if table.is_empty() { &empty_entry } else { &table };
        let light_slice: &[PunctualRecord] = if punctual.is_empty() { &empty_light } else { &punctual };
        gpu.upload(&light_table, 0, bytemuck::cast_slice(table_slice))?;
        gpu.upload(&punctual_lights, 0, bytemuck::cast_slice(light_slice))?;
        // A table without any power has no entries; then nothing is sampled.
        let is_dark = table.is_empty();
        Ok(Self {
            triangle_count: if is_dark { 0 } else { scene.emissive_triangles.len() as u32 },
            punctual_count: if is_dark { 0 } else { punctual.len() as u32 },
            environment_count: if is_dark { 0 } else { environment_count },
            emission_scale: state.emissive_strength,
            environment_scale: state.environment_strength,
            light_table,
            punctual_lights,
        })
    }

    /// Binds to a pass the light buffers its kernel uses.
    pub fn bind<'g>(&self, mut pass: surfelcast_gpu::PassBuilder<'g>) -> surfelcast_gpu::PassBuilder<'g> {
        for (name, buffer) in [("light_table", &self.light_table), ("punctual_lights", &self.punctual_lights)] {
            pass = pass.bind_if_bound(name, buffer);
        }
        pass
    }
}

fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Emitted power of each light up to a common factor: triangles, punctual lights, then the environment image.
fn light_weights(scene: &Scene, state: &LightState) -> (Vec<f32>, u32) {
    use std::f32::consts::PI;
    let disk = PI * scene.bounds.radius().powi(2);
    let mut weights: Vec<f32> = scene
        .emissive_triangles
        .iter()
        .map(|light| PI * light.area * luminance(light.mean_radiance) * state.emissive_strength)
        .collect();
    weights.extend(state.punctual.iter().map(|light| {
        let intensity = luminance(light.intensity);
        match light.kind {
            PunctualKind::Point => 4.0 * PI * intensity,
            PunctualKind::Spot { outer_angle, .. } => 2.0 * PI * (1.0 - outer_angle.cos()) * intensity,
            PunctualKind::Directional => disk * intensity,
        }
    }));
    let mut environment_count = 0;
    // A constant environment is sampled by scattering alone, whose density fits it.
    if let Environment::Map(map) = &scene.environment {
        environment_count = 1;
        let mean = mean_environment_luminance(map);
        weights.push(disk * PI * mean * state.environment_strength);
    }
    balance(&mut weights, |index| {
        let punctual = index.checked_sub(scene.emissive_triangles.len()).and_then(|index| state.punctual.get(index));
        index == scene.emissive_triangles.len() + state.punctual.len()
            || punctual.is_some_and(|light| matches!(light.kind, PunctualKind::Directional))
    });
    let sum: f64 = weights.iter().map(|&w| f64::from(w)).sum();
    let lit = weights.iter().filter(|&&w| w > 0.0).count();
    if lit > 0 {
        let floor = (sum * f64::from(UNIFORM_SHARE) / lit as f64) as f32;
        for weight in weights.iter_mut().filter(|w| **w > 0.0) {
            *weight = *weight * (1.0 - UNIFORM_SHARE) + floor;
        }
    }
    (weights, environment_count)
}

/// Power overestimates infinitely distant lights, which are mostly occluded indoors. So such lights together are chosen
/// at most as often as all others together.
fn balance(weights: &mut [f32], is_infinite: impl Fn(usize) -> bool) {
    let sum = |wanted: bool| {
        let chosen = weights.iter().enumerate().filter(|(index, _)| is_infinite(*index) == wanted);
        chosen.map(|(_, &weight)| f64::from(weight)).sum::<f64>()
    };
    let (infinite, local) = (sum(true), sum(false));
    if local > 0.0 && infinite > local {
        let scale = (local / infinite) as f32;
        for (index, weight) in weights.iter_mut().enumerate() {
            if is_infinite(index) {
                *weight *= scale;
            }
        }
    }
}

fn punctual_record(light: &PunctualLight) -> PunctualRecord {
    let (kind, inner, outer) = match light.kind {
        PunctualKind::Point => (0, 0.0, 0.0),
        PunctualKind::Spot { inner_angle, outer_angle } => (1, inner_angle, outer_angle),
        PunctualKind::Directional => (2, 0.0, 0.0),
    };
    // KHR_lights_punctual: squared linear ramp of the cosine between the cones. A minimal difference of the cosines
    // keeps the scale finite.
    let (inner_cos, outer_cos) = (f32::cos(inner), f32::cos(outer));
    let cone_scale = 1.0 / (inner_cos - outer_cos).max(1e-4);
    PunctualRecord {
        position: light.position.to_array(),
        kind,
        direction: light.direction.to_array(),
        range: if light.range.is_finite() { light.range } else { 1e18 },
        intensity: light.intensity,
        cone_scale,
        cone_offset: -outer_cos * cone_scale,
        padding0: 0,
        padding1: 0,
        padding2: 0,
    }
}

fn mean_environment_luminance(map: &EnvironmentMap) -> f32 {
    let mut sum = 0.0f64;
    let mut solid_angle = 0.0f64;
    for (row, texels) in map.radiance.chunks_exact(map.width as usize).enumerate() {
        let sin_theta = (std::f64::consts::PI * (row as f64 + 0.5) / f64::from(map.height)).sin();
        sum += sin_theta * texels.iter().map(|&c| f64::from(luminance(c))).sum::<f64>();
        solid_angle += sin_theta * texels.len() as f64;
    }
    (sum / solid_angle.max(1e-30)) as f32
}

/// Weight of each texel: the brightest of its neighbourhood times its solid angle. The look-up is bilinear, so a dark
/// texel next to a bright one still receives its light and must not have density 0.
pub(crate) fn environment_weights(map: &EnvironmentMap) -> Vec<f32> {
    let (width, height) = (map.width as usize, map.height as usize);
    let lum = |x: usize, y: usize| luminance(map.radiance[y * width + x]);
    let mut weights = Vec::with_capacity(width * height);
    for y in 0..height {
        let sin_theta = (std::f32::consts::PI * (y as f32 + 0.5) / height as f32).sin();
        for x in 0..width {
            let mut sum = 0.0;
            for row in [y.saturating_sub(1), y, (y + 1).min(height - 1)] {
                for column in [(x + width - 1) % width, x, (x + 1) % width] {
                    let share = if row == y && column == x { 0.5 } else { 0.0625 };
                    sum += lum(column, row) * share;
                }
            }
            weights.push(sum * sin_theta);
        }
    }
    weights
}

/// An alias table as the shader reads it; empty where all weights are 0.
pub(crate) fn alias_entries(weights: &[f32]) -> Vec<AliasEntry> {
    let table = AliasTable::new(weights);
    table
        .entries
        .iter()
        .map(|entry| AliasEntry {
            threshold: entry.threshold,
            alias_index: entry.alias,
            probability: entry.pmf,
            padding: 0,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::balance;

    #[test]
    fn infinitely_distant_lights_take_half_at_most() {
        let mut weights = [1.0, 3.0, 90.0, 10.0];
        balance(&mut weights, |index| index >= 2);
        assert_eq!(weights[..2], [1.0, 3.0]);
        assert!((weights[2] - 3.6).abs() < 1e-5 && (weights[3] - 0.4).abs() < 1e-5);
        let mut alone = [0.0, 5.0];
        balance(&mut alone, |index| index == 1);
        assert_eq!(alone, [0.0, 5.0]);
    }
}
