//! Passes that any rendering technique may use: scene upload, light table, frame uniforms, visibility, batches of
//! samples, direct light with reuse and filter, settling, first-surface outputs, error audit, image-space Poisson
//! solver, tone map. None of them knows a technique.

pub mod audit;
pub mod batches;
pub mod counters;
pub mod direct_light;
pub mod features;
pub mod first_surface;
pub mod frame;
pub mod kernels;
pub mod lights;
pub mod materials;
pub mod path_samples;
pub mod poisson;
pub mod scan;
pub mod settling;
pub mod step;
pub mod tone_map;
pub mod upload;
pub mod visibility;

use surfelcast_gpu::PassTime;

/// Sums the times of passes of one name.
pub fn merge_passes(into: &mut Vec<PassTime>, from: Vec<PassTime>) {
    for pass in from {
        match into.iter_mut().find(|known| known.name == pass.name) {
            Some(known) => {
                known.gpu_ms += pass.gpu_ms;
                known.dispatches += pass.dispatches;
            }
            None => into.push(pass),
        }
    }
}

/// Workgroups of 64 threads that cover `pixel_count` pixels, in rows of at most 65,535, the limit of one dimension that
/// every device supports.
pub fn workgroups_of(pixel_count: u32) -> [u32; 3] {
    let groups = pixel_count.div_ceil(64);
    let rows = groups.div_ceil(65_535).max(1);
    [groups.div_ceil(rows), rows, 1]
}

#[cfg(test)]
mod tests {
    use super::workgroups_of;

    #[test]
    fn large_pictures_take_several_rows() {
        assert_eq!(workgroups_of(64), [1, 1, 1]);
        for pixel_count in [1, 65, 4_194_240, 4_194_241, 8_300_000, 64_000_000] {
            let [columns, rows, _] = workgroups_of(pixel_count);
            assert!(columns <= 65_535 && rows <= 65_535);
            assert!(u64::from(columns) * u64::from(rows) * 64 >= u64::from(pixel_count));
        }
    }
}
