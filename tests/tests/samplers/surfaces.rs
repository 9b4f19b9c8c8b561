//! Surfaces and BSDFs in a path: both sides, tilted mapped normals, no black fringes, energy conservation.

use glam::Vec3;
use surfelcast_gpu::{Buffer, Gpu, Kernel, MemoryKind};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::MaterialRecord;

use crate::device;
use crate::statistics::mean_and_error;

const COUNT: u32 = 1 << 16;

mod records {
    surfelcast_shaders::gpu_structs! {
        /// As in the kernel.
        pub struct SurfaceUniforms {
            /// Towards the viewer.
            pub wo: [f32; 3],
            /// Samples.
            pub count: u32,
            /// Mapped normal.
            pub n_shading: [f32; 3],
            /// 0 to 1.
            pub metallic: f32,
            /// Seed.
            pub seed: [u32; 2],
            /// 0 to 1.
            pub roughness: f32,
            /// Unused.
            pub padding: u32,
        }

        /// As in the kernel.
        pub struct DrawnSurface {
            /// Sampled direction.
            pub wi: [f32; 3],
            /// Density.
            pub pdf: f32,
            /// Value over density.
            pub weight: [f32; 3],
            /// Whether the path continues.
            pub is_valid: u32,
            /// By evaluation.
            pub evaluated_weight: [f32; 3],
            /// By evaluation.
            pub evaluated_pdf: f32,
        }
    }
}
use records::{DrawnSurface, SurfaceUniforms};

struct Bench {
    gpu: Gpu,
    kernel: Kernel,
    materials: Buffer,
}

impl Bench {
    fn new(features: Features) -> Self {
        let gpu = device::gpu();
        let kernel = gpu.kernel_from_source("draw_surface", include_str!("draw_surface.wesl"), features);
        let kernel = kernel.unwrap_or_else(|error| panic!("{error}"));
        let differences = surfelcast_shaders::layout::differences(&records::structs(), kernel.reflection());
        assert!(differences.is_empty(), "{differences:?}");
        let material = MaterialRecord { base_color: [1.0; 4], ior: 1.5, ..MaterialRecord::default() };
        let materials = gpu.buffer("materials", MemoryKind::Scene, size_of::<MaterialRecord>() as u64).expect("fits");
        gpu.upload(&materials, 0, bytemuck::bytes_of(&material)).expect("uploads");
        Bench { gpu, kernel, materials }
    }

    fn draw(&self, uniforms: SurfaceUniforms) -> Vec<DrawnSurface> {
        let uniforms = SurfaceUniforms { count: COUNT, seed: [41, 43], ..uniforms };
        device::run(&self.gpu, &self.kernel, "drawn", COUNT, |pass| {
            pass.uniform("draw", bytemuck::bytes_of(&uniforms)).bind_if_bound("materials", &self.materials)
        })
    }
}

fn tilted(angle: f32) -> [f32; 3] {
    [angle.sin(), 0.0, angle.cos()]
}

/// Mean weight and its error in a white furnace.
fn albedo(drawn: &[DrawnSurface]) -> (f64, f64) {
    mean_and_error(drawn.iter().map(|draw| f64::from(draw.weight[1])))
}

const ANGLES: [f32; 5] = [-1.5, -0.9, 0.0, 0.7, 1.45];

#[test]
fn mapped_normals_neither_gain_energy_nor_turn_black() {
    let bench = Bench::new(Features::PBR);
    for view in ANGLES {
        for tilt in [-1.3, -0.5, 0.0, 0.5, 1.3_f32] {
            for (metallic, roughness) in [(0.0, 1.0), (1.0, 1.0), (1.0, 0.35), (0.0, 0.35)] {
                let u = SurfaceUniforms {
                    wo: tilted(view),
                    n_shading: tilted(tilt),
                    metallic,
                    roughness,
                    ..Default::default()
                };
                let drawn = bench.draw(u);
                let (mean, error) = albedo(&drawn);
                // A white plastic may exceed one by the reflectance of its coat (see the tests of the twins); a metal
                // may not.
                let limit = if metallic == 1.0 { 1.0 } else { 2.0 };
                assert!(mean <= limit + 4.0 * error + 1e-3, "view {view}, tilt {tilt}, {u:?}: {mean} +- {error}");
                assert!(mean > 0.02, "view {view}, tilt {tilt}, {u:?}: {mean} is black");
                for draw in drawn.iter().filter(|draw| draw.is_valid != 0) {
                    assert!(draw.wi[2] > 0.0, "reflected through the surface: {u:?} {draw:?}");
                    assert!(draw.weight.iter().chain(&[draw.pdf]).all(|x| x.is_finite() && *x >= 0.0), "{draw:?}");
                    assert!((draw.pdf - draw.evaluated_pdf).abs() <= 1e-3 * draw.pdf, "{draw:?}");
                    assert!((draw.weight[1] - draw.evaluated_weight[1]).abs() <= 1e-3 * draw.weight[1], "{draw:?}");
                }
            }
        }
    }
}

#[test]
fn the_lambert_variant_is_white_from_everywhere() {
    let bench = Bench::new(Features::NONE);
    for view in ANGLES {
        let drawn = bench.draw(SurfaceUniforms { wo: tilted(view), n_shading: tilted(0.0), ..Default::default() });
        let (mean, _) = albedo(&drawn);
        assert!((mean - 1.0).abs() < 1e-4, "{view}: {mean}");
    }
}

#[test]
fn both_sides_scatter_alike() {
    for features in [Features::NONE, Features::PBR] {
        let bench = Bench::new(features);
        for view in ANGLES {
            let front = SurfaceUniforms {
                wo: tilted(view),
                n_shading: tilted(0.0),
                metallic: 0.3,
                roughness: 0.5,
                ..Default::default()
            };
            let back = SurfaceUniforms { wo: (-Vec3::from_array(front.wo)).to_array(), ..front };
            let ((a, error_a), (b, error_b)) = (albedo(&bench.draw(front)), albedo(&bench.draw(back)));
            assert!((a - b).abs() <= 4.0 * (error_a + error_b) + 1e-4, "{view}: {a} {b}");
            assert!(bench.draw(back).iter().all(|draw| draw.is_valid == 0 || draw.wi[2] < 0.0));
        }
    }
}
