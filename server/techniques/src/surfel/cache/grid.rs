//! Where the grid lies and how large it is; `lib/gi/grid.wesl` says what is in it.

use surfelcast_shaders::constants::SURFEL_GRID_OCTAVES;

use super::cameras::CacheCamera;

/// Radii of a surfel that a cell of the trapezoidal grid is wide.
const CELL_RADII: f32 = 4.0;
/// Slots of cascades for each surfel: a few surfels share a cell and each overlaps several, so that few cells share a
/// slot.
const SLOTS_PER_SURFEL: u32 = 8;
const FEWEST_SLOTS: u32 = 1 << 12;
/// Cells along a side of the trapezoidal grid's cube.
const CELLS_RANGE: [f32; 2] = [8.0, 64.0];

/// Shape of a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GridShape {
    /// Slots.
    pub(super) slots: u32,
    /// Of the trapezoidal grid: cells along each side of its cube.
    pub(super) cells: u32,
    /// Slices of each region around that.
    pub(super) slices: u32,
    /// Its centre, scene space.
    pub(super) center: [f32; 3],
    /// Half the edge of its cube, metres.
    pub(super) half_edge: f32,
}

impl GridShape {
    /// Hashed cascades for `surfels` surfels. The number of slots is a power of two, at most `most_slots`.
    pub(super) fn cascades(surfels: u32, most_slots: u32) -> Self {
        let slots = surfels.saturating_mul(SLOTS_PER_SURFEL).max(FEWEST_SLOTS).min(most_slots).next_power_of_two();
        Self { slots, cells: 0, slices: 0, center: [0.0; 3], half_edge: 0.0 }
    }

    /// The trapezoidal grid around a camera, out to the far end of the scene, with cells a few radii wide as that
    /// camera sees them.
    pub(super) fn trapezoidal(camera: CacheCamera, scene_radius: f32, radius_pixels: f32) -> Self {
        let tangent = CELL_RADII * radius_pixels * camera.pixel_size;
        // Across the cube's face lie directions with tangents from -1 to 1.
        let cells = (2.0 / tangent.max(f32::MIN_POSITIVE)).clamp(CELLS_RANGE[0], CELLS_RANGE[1]) as u32;
        // Slices as deep as cells are wide.
        let slices = (SURFEL_GRID_OCTAVES / (1.0 + 2.0 / cells as f32).log2()).ceil() as u32;
        let [x, y, z] = camera.position;
        let reach = scene_radius + (x * x + y * y + z * z).sqrt();
        let half_edge = (reach * (-SURFEL_GRID_OCTAVES).exp2()).max(f32::MIN_POSITIVE);
        let slots = cells * cells * cells + 6 * slices * cells * cells;
        Self { slots, cells, slices, center: camera.position, half_edge }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cascades_have_a_power_of_two_of_slots_for_live_surfels_up_to_their_room() {
        let slots = |surfels| GridShape::cascades(surfels, 1 << 20).slots;
        assert_eq!((slots(0), slots(5_000), slots(70_000), slots(u32::MAX)), (1 << 12, 1 << 16, 1 << 20, 1 << 20));
    }

    #[test]
    fn a_trapezoidal_grid_reaches_as_far_as_the_scene_and_stays_within_its_memory() {
        for (pixel_size, position) in
            [(1e-9, [0.0; 3]), (1e-3, [3.0, 0.0, -4.0]), (0.1, [1e3, 0.0, 0.0]), (10.0, [0.0; 3])]
        {
            let shape = GridShape::trapezoidal(CacheCamera { position, pixel_size }, 2.0, 5.0);
            let distance = position.iter().map(|p| p * p).sum::<f32>().sqrt();
            assert!(shape.half_edge * 32.0 >= (distance + 2.0) * 0.999, "{shape:?}");
            assert!(shape.slots <= 4_000_000 && shape.slots >= 512, "{shape:?}");
        }
        // A slice is as deep as a cell at its beginning is wide.
        let shape = GridShape::trapezoidal(CacheCamera { position: [0.0; 3], pixel_size: 1e-3 }, 2.0, 10.0);
        let growth = (SURFEL_GRID_OCTAVES / shape.slices as f32).exp2();
        assert!((growth - (1.0 + 2.0 / shape.cells as f32)).abs() < 1e-3, "{growth}");
    }
}
