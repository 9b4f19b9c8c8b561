//! Light sources of a scene.

use glam::Vec3;

/// A triangle whose material emits. Scene space, counter-clockwise seen from the side that emits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmissiveTriangle {
    /// Corners, scene space.
    pub corners: [Vec3; 3],
    /// Index into [`crate::SceneGeometry::triangles`].
    pub triangle: u32,
    /// Index into [`crate::Scene::materials`].
    pub material: u32,
    /// Mean emitted radiance over the triangle (texture averaged), linear RGB. Chooses the light; the radiance of a
    /// point is evaluated exactly.
    pub mean_radiance: [f32; 3],
    /// Area, square metres; may be 0 for degenerate triangles, which are never chosen.
    pub area: f32,
}

/// Shape of a punctual light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PunctualKind {
    /// Intensity in W/sr, the same in all directions.
    Point,
    /// Intensity in W/sr on the axis, falling smoothly (glTF KHR_lights_punctual) between the cone angles.
    Spot {
        /// Half angle of full intensity, radians.
        inner_angle: f32,
        /// Half angle where intensity reaches 0, radians.
        outer_angle: f32,
    },
    /// Irradiance in W/m^2 on a surface that faces the light.
    Directional,
}

/// A light without extent (KHR_lights_punctual).
#[derive(Clone, Debug, PartialEq)]
pub struct PunctualLight {
    /// Name in the file or given by the user.
    pub name: String,
    /// Shape and unit of `intensity`.
    pub kind: PunctualKind,
    /// Position, scene space (unused for directional lights).
    pub position: Vec3,
    /// Unit vector in which the light shines, scene space (unused for point lights).
    pub direction: Vec3,
    /// Colour x intensity, linear RGB.
    pub intensity: [f32; 3],
    /// Distance beyond which a point or spot light is dark, metres; infinite where the file gives none.
    pub range: f32,
}

/// One column of an [`AliasTable`].
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct AliasEntry {
    /// A fraction below this keeps the column's own item.
    pub threshold: f32,
    /// Item taken otherwise.
    pub alias: u32,
    /// Probability of the column's own item over the whole table.
    pub pmf: f32,
}

/// Chooses items in proportion to weights in constant time (Vose 1991).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AliasTable {
    /// One entry an item; empty where no weight is positive.
    pub entries: Vec<AliasEntry>,
    /// Sum of the weights.
    pub total: f64,
}

impl AliasTable {
    /// Builds the table. Weights that are negative or not finite count as 0. The same weights give the same table.
    pub fn new(weights: &[f32]) -> Self {
        let weight = |w: &f32| if w.is_finite() { f64::from(w.max(0.0)) } else { 0.0 };
        let total: f64 = weights.iter().map(weight).sum();
        if total <= 0.0 {
            return Self::default();
        }
        let count = weights.len() as f64;
        // shares of the average: columns below 1 are filled up by those above
        let mut share: Vec<f64> = weights.iter().map(|w| weight(w) / total * count).collect();
        let (mut low, mut high): (Vec<usize>, Vec<usize>) = (0..share.len()).partition(|&k| share[k] < 1.0);
        let mut entries: Vec<AliasEntry> = weights
            .iter()
            .enumerate()
            .map(|(k, w)| AliasEntry { threshold: 1.0, alias: k as u32, pmf: (weight(w) / total) as f32 })
            .collect();
        while let (Some(&small), Some(&large)) = (low.last(), high.last()) {
            low.pop();
            entries[small].threshold = share[small] as f32;
            entries[small].alias = large as u32;
            share[large] -= 1.0 - share[small];
            if share[large] < 1.0 {
                high.pop();
                low.push(large);
            }
        }
        // What is left differs from 1 by rounding only, unless it is an item of weight 0, which must never be chosen.
        let heaviest = (0..share.len()).max_by(|&a, &b| entries[a].pmf.total_cmp(&entries[b].pmf)).unwrap_or(0);
        for k in low {
            if entries[k].pmf == 0.0 {
                (entries[k].threshold, entries[k].alias) = (0.0, heaviest as u32);
            }
        }
        Self { entries, total }
    }

    /// The item that a number in [0, 1) chooses; `None` for an empty table.
    pub fn sample(&self, random: f32) -> Option<u32> {
        let scaled = random * self.entries.len() as f32;
        let column = (scaled as usize).min(self.entries.len().checked_sub(1)?);
        let entry = &self.entries[column];
        Some(if scaled - (column as f32) < entry.threshold { column as u32 } else { entry.alias })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weights(count: u32) -> Vec<f32> {
        (0..count).map(|k| if k % 5 == 0 { 0.0 } else { 1.5f32.powi((k * 7 % 23) as i32) }).collect()
    }

    #[test]
    fn columns_add_up_to_the_weights() {
        for count in [1u32, 2, 3, 64, 1000] {
            let mut weights = weights(count);
            weights[0] = 0.25;
            let table = AliasTable::new(&weights);
            let mut mass = vec![0.0f64; weights.len()];
            for (k, entry) in table.entries.iter().enumerate() {
                mass[k] += f64::from(entry.threshold) / f64::from(count);
                mass[entry.alias as usize] += f64::from(1.0 - entry.threshold) / f64::from(count);
            }
            for (k, weight) in weights.iter().enumerate() {
                let expected = f64::from(*weight) / table.total;
                assert!((mass[k] - expected).abs() < 1e-6, "{count}: item {k} has {} not {expected}", mass[k]);
                assert!((f64::from(table.entries[k].pmf) - expected).abs() < 1e-7);
                assert!(*weight > 0.0 || mass[k] == 0.0, "an item of weight 0 can be chosen");
            }
        }
    }

    #[test]
    fn sampling_passes_chi_square() {
        let weights = weights(40);
        let table = AliasTable::new(&weights);
        let draws = 400_000u32;
        let mut counts = vec![0u32; weights.len()];
        let mut state = 1u32;
        for _ in 0..draws {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
            let random = (((word >> 22) ^ word) >> 8) as f32 / (1 << 24) as f32;
            counts[table.sample(random).unwrap() as usize] += 1;
        }
        let (mut chi_square, mut bins) = (0.0, 0);
        for (count, entry) in counts.iter().zip(&table.entries) {
            let expected = f64::from(entry.pmf) * f64::from(draws);
            if expected > 5.0 {
                chi_square += (f64::from(*count) - expected).powi(2) / expected;
                bins += 1;
            }
        }
        // mean bins - 1, standard deviation sqrt(2 bins): 5 of them above
        let limit = f64::from(bins) + 5.0 * (2.0 * f64::from(bins)).sqrt();
        assert!(chi_square < limit, "chi-square {chi_square} over {bins} bins");
    }

    #[test]
    fn no_weight_makes_an_empty_table() {
        assert!(AliasTable::new(&[]).entries.is_empty());
        assert!(AliasTable::new(&[0.0, -1.0, f32::NAN]).entries.is_empty());
        assert_eq!(AliasTable::default().sample(0.5), None);
    }
}
