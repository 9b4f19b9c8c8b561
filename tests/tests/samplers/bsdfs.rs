//! Directions: chi-square of samples of the device against the density of the twin, white furnaces, twin against
//! device.

use std::f64::consts::PI;

use glam::Vec3;
use surfelcast_gpu::{Gpu, Kernel};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::twin::bsdf::Evaluation;
use surfelcast_shaders::twin::bsdf::dielectric::{Dielectric, evaluate_dielectric, reflectance};
use surfelcast_shaders::twin::bsdf::lambert::evaluate_lambert;
use surfelcast_shaders::twin::bsdf::metallic_roughness::{evaluate_metallic_roughness, metallic_roughness};
use surfelcast_shaders::twin::bsdf::microfacet::ggx_visible_pdf;
use surfelcast_shaders::twin::core::rng::{PathKey, random4};
use surfelcast_shaders::twin::core::sampling::sample_triangle;

use crate::device;
use crate::statistics::{Suite, chi_square, mean_and_error};

const COUNT: u32 = 1 << 17;
/// Cells of a histogram over the sphere, in cos(theta) and phi.
const CELLS: [usize; 2] = [24, 24];
/// Points along each side of a cell at which the density is evaluated.
const FINENESS: usize = 48;

mod records {
    surfelcast_shaders::gpu_structs! {
        /// As in the kernel.
        pub struct DrawUniforms {
            /// Viewer.
            pub wo: [f32; 3],
            /// Samples.
            pub count: u32,
            /// Base colour or tint.
            pub color: [f32; 3],
            /// Sampler.
            pub sampler_index: u32,
            /// 0 to 1.
            pub metallic: f32,
            /// 0 to 1.
            pub roughness: f32,
            /// Index of refraction.
            pub ior: f32,
            /// A sheet.
            pub is_thin: u32,
            /// Seed.
            pub seed: [u32; 2],
            /// Perfectly smooth.
            pub is_delta: u32,
            /// Unused.
            pub padding: u32,
        }

        /// As in the kernel.
        pub struct Drawn {
            /// Unit vector.
            pub direction: [f32; 3],
            /// Stated density.
            pub pdf: f32,
            /// Value over density.
            pub weight: [f32; 3],
            /// Not black.
            pub is_valid: u32,
            /// Evaluated.
            pub value: [f32; 3],
            /// Evaluated.
            pub evaluated_pdf: f32,
            /// Sampled lobe.
            pub random: [f32; 4],
        }
    }
}
use records::{DrawUniforms, Drawn};

const COSINE: u32 = 0;
const VISIBLE_NORMAL: u32 = 1;
const METALLIC_ROUGHNESS: u32 = 2;
const DIELECTRIC: u32 = 3;
const TRIANGLE: u32 = 4;

struct Bench {
    gpu: Gpu,
    kernel: Kernel,
}

impl Bench {
    fn new() -> Self {
        let gpu = device::gpu();
        let kernel = gpu.kernel_from_source("draw_bsdf", include_str!("draw_bsdf.wesl"), Features::NONE);
        let kernel = kernel.unwrap_or_else(|error| panic!("{error}"));
        let differences = surfelcast_shaders::layout::differences(&records::structs(), kernel.reflection());
        assert!(differences.is_empty(), "{differences:?}");
        Bench { gpu, kernel }
    }

    fn draw(&self, uniforms: &DrawUniforms) -> Vec<Drawn> {
        let uniforms = DrawUniforms { count: COUNT, ..*uniforms };
        device::run(&self.gpu, &self.kernel, "drawn", COUNT, |pass| pass.uniform("draw", bytemuck::bytes_of(&uniforms)))
    }
}

fn direction(cos_theta: f32, phi: f32) -> Vec3 {
    let sin_theta = (1.0 - cos_theta * cos_theta).sqrt();
    Vec3::new(sin_theta * phi.cos(), sin_theta * phi.sin(), cos_theta)
}

/// Cell of a direction. The first axis is `theta`, over which lobes around the pole spread more evenly than over its
/// cosine.
fn cell(w: Vec3) -> usize {
    let theta = f64::from(w.z.clamp(-1.0, 1.0)).acos() / PI;
    let phi = (f64::from(w.y).atan2(f64::from(w.x)) / (2.0 * PI) + 1.0).fract();
    let row = ((theta * CELLS[0] as f64) as usize).min(CELLS[0] - 1);
    let column = ((phi * CELLS[1] as f64) as usize).min(CELLS[1] - 1);
    row * CELLS[1] + column
}

/// Integral of a density over each cell.
fn cell_probabilities(pdf: impl Fn(Vec3) -> f64) -> Vec<f64> {
    let (rows, columns) = (CELLS[0] * FINENESS, CELLS[1] * FINENESS);
    let mut cells = vec![0.0; CELLS[0] * CELLS[1]];
    for row in 0..rows {
        let theta = (row as f64 + 0.5) / rows as f64 * PI;
        let area = theta.sin() * (PI / rows as f64) * (2.0 * PI / columns as f64);
        for column in 0..columns {
            let phi = (column as f64 + 0.5) / columns as f64 * 2.0 * PI;
            let w = Vec3::new((theta.sin() * phi.cos()) as f32, (theta.sin() * phi.sin()) as f32, theta.cos() as f32);
            cells[row / FINENESS * CELLS[1] + column / FINENESS] += pdf(w) * area;
        }
    }
    cells
}

/// p-value of directions against a density; rejected samples are one more cell.
fn p_value(drawn: &[Drawn], is_failed: impl Fn(&Drawn) -> bool, pdf: impl Fn(Vec3) -> f64) -> f64 {
    let probabilities = cell_probabilities(pdf);
    let mut observed = vec![0.0; probabilities.len() + 1];
    for draw in drawn {
        let index = if is_failed(draw) { probabilities.len() } else { cell(Vec3::from_array(draw.direction)) };
        observed[index] += 1.0;
    }
    let count = drawn.len() as f64;
    let mut expected: Vec<f64> = probabilities.iter().map(|probability| probability * count).collect();
    expected.push((count - expected.iter().sum::<f64>()).max(0.0));
    chi_square(&observed, &expected)
}

const VIEWS: [(f32, f32); 3] = [(0.99, 0.3), (0.6, 2.0), (0.15, -1.2)];
const ROUGHNESSES: [f32; 3] = [1.0, 0.6, 0.35];

fn uniforms(sampler_index: u32, view: (f32, f32)) -> DrawUniforms {
    DrawUniforms {
        sampler_index,
        wo: direction(view.0, view.1).to_array(),
        color: [1.0; 3],
        ior: 1.5,
        seed: [17, 23],
        ..DrawUniforms::default()
    }
}

fn of_index(u: &DrawUniforms) -> (Vec3, Vec3) {
    (Vec3::from_array(u.wo), Vec3::from_array(u.color))
}

fn metals() -> Vec<DrawUniforms> {
    let mut found = Vec::new();
    for view in VIEWS {
        for roughness in ROUGHNESSES {
            for metallic in [0.0, 0.4, 1.0] {
                found.push(DrawUniforms { metallic, roughness, ..uniforms(METALLIC_ROUGHNESS, view) });
            }
        }
    }
    found
}

fn dielectrics() -> Vec<DrawUniforms> {
    let mut found = Vec::new();
    for view in VIEWS {
        for roughness in ROUGHNESSES {
            for (ior, is_thin) in [(1.5, 0), (1.0 / 1.5, 0), (1.33, 1)] {
                found.push(DrawUniforms { roughness, ior, is_thin, ..uniforms(DIELECTRIC, view) });
            }
        }
    }
    found
}

fn twin_dielectric(u: &DrawUniforms) -> Dielectric {
    Dielectric {
        eta: u.ior,
        alpha: u.roughness * u.roughness,
        is_thin: u.is_thin != 0,
        tint: Vec3::from_array(u.color),
    }
}

fn twin(u: &DrawUniforms, wi: Vec3) -> Evaluation {
    let (wo, color) = of_index(u);
    match u.sampler_index {
        COSINE => evaluate_lambert(color, wi),
        METALLIC_ROUGHNESS => {
            evaluate_metallic_roughness(&metallic_roughness(color, u.metallic, u.roughness, u.ior, wo.z), wo, wi)
        }
        _ => evaluate_dielectric(&twin_dielectric(u), wo, wi),
    }
}

#[test]
fn random_numbers_are_the_same_on_both_sides() {
    for (pixel, draw) in Bench::new().draw(&uniforms(COSINE, VIEWS[0])).iter().enumerate() {
        let key = PathKey { pixel: pixel as u32, sample: 5, seed: [17, 23] };
        assert_eq!(draw.random, random4(key, 3), "pixel {pixel}");
    }
}

#[test]
fn histograms_follow_their_densities() {
    let bench = Bench::new();
    let mut suite = Suite::default();
    let drawn = bench.draw(&uniforms(COSINE, VIEWS[0]));
    suite.add("cosine".to_owned(), p_value(&drawn, |_| false, |w| f64::from(w.z.max(0.0)) / PI));
    for view in VIEWS {
        for roughness in ROUGHNESSES {
            let u = DrawUniforms { roughness, ..uniforms(VISIBLE_NORMAL, view) };
            let (wo, alpha) = (Vec3::from_array(u.wo), roughness * roughness);
            let pdf = |h: Vec3| f64::from(if h.z > 0.0 { ggx_visible_pdf(wo, h, alpha) } else { 0.0 });
            suite.add(format!("visible normals {view:?} {roughness}"), p_value(&bench.draw(&u), |_| false, pdf));
        }
    }
    for u in metals() {
        let drawn = bench.draw(&u);
        let p = p_value(&drawn, |draw| draw.direction[2] <= 0.0, |w| f64::from(twin(&u, w).pdf_solid_angle));
        suite.add(format!("{u:?}"), p);
    }
    for u in dielectrics() {
        let drawn = bench.draw(&u);
        let p = p_value(&drawn, |draw| draw.is_valid == 0, |w| f64::from(twin(&u, w).pdf_solid_angle));
        suite.add(format!("{u:?}"), p);
    }
    suite.judge();
}

/// Side of the grid over two barycentric weights.
const SIDE: usize = 16;

#[test]
fn points_fill_a_triangle_evenly() {
    let drawn = Bench::new().draw(&uniforms(TRIANGLE, VIEWS[0]));
    let (mut observed, mut expected) = (vec![0.0; SIDE * SIDE], vec![0.0; SIDE * SIDE]);
    for draw in &drawn {
        let [w0, w1, w2] = draw.direction;
        assert!(w0 >= 0.0 && w1 >= 0.0 && w2 >= 0.0 && (w0 + w1 + w2 - 1.0).abs() < 1e-5, "{draw:?}");
        let twin = sample_triangle(glam::Vec2::new(draw.random[0], draw.random[1]));
        assert!(twin.abs_diff_eq(Vec3::from_array(draw.direction), 1e-5), "{draw:?} {twin}");
        let index = |w: f32| ((w * SIDE as f32) as usize).min(SIDE - 1);
        observed[index(w1) * SIDE + index(w2)] += 1.0;
    }
    // Whole squares below the diagonal, half ones on it.
    for (cell, expected) in expected.iter_mut().enumerate() {
        let share = match (cell / SIDE + cell % SIDE).cmp(&(SIDE - 1)) {
            std::cmp::Ordering::Less => 2.0,
            std::cmp::Ordering::Equal => 1.0,
            std::cmp::Ordering::Greater => 0.0,
        };
        *expected = share * drawn.len() as f64 / (SIDE * SIDE) as f64;
    }
    let mut suite = Suite::default();
    suite.add("triangle".to_owned(), chi_square(&observed, &expected));
    suite.judge();
}

/// Relative difference, with an absolute tolerance for small values.
fn differs(a: f32, b: f32, tolerance: f32) -> bool {
    (a - b).abs() > tolerance * a.abs().max(b.abs()) + 1e-5
}

#[test]
fn device_and_twin_agree_on_value_and_density() {
    let bench = Bench::new();
    for u in metals().into_iter().chain(dielectrics()).chain([uniforms(COSINE, VIEWS[1])]) {
        let mut worst = 0;
        for draw in bench.draw(&u).iter().step_by(7) {
            let expected = twin(&u, Vec3::from_array(draw.direction));
            // Refraction near the critical angle divides by a difference with cancellation.
            let tolerance = 5e-3;
            if differs(draw.evaluated_pdf, expected.pdf_solid_angle, tolerance)
                || (0..3).any(|channel| differs(draw.value[channel], expected.value[channel], tolerance))
            {
                worst += 1;
                assert!(worst <= 4, "{u:?}\n{draw:?}\n{expected:?}");
            }
        }
    }
}

#[test]
fn what_is_drawn_weighs_value_over_density() {
    let bench = Bench::new();
    for u in dielectrics() {
        let mut outliers = 0;
        for draw in bench.draw(&u).iter().filter(|draw| draw.is_valid != 0) {
            let weight = draw.value[0] / draw.evaluated_pdf.max(1e-30);
            if differs(draw.pdf, draw.evaluated_pdf, 2e-2) || differs(draw.weight[0], weight, 2e-2) {
                outliers += 1;
                assert!(outliers <= COUNT / 2000, "{u:?}\n{draw:?}");
            }
        }
    }
}

#[test]
fn white_furnaces_give_back_what_the_twins_integrate_to() {
    let bench = Bench::new();
    for u in metals().into_iter().chain(dielectrics()).chain([uniforms(COSINE, VIEWS[1])]) {
        let drawn = bench.draw(&u);
        let (mean, error) = mean_and_error(drawn.iter().map(|draw| f64::from(draw.weight[1])));
        let albedo: f64 = cell_probabilities(|w| f64::from(twin(&u, w).value.y)).iter().sum();
        assert!((mean - albedo).abs() < 4.5 * error + 2e-3, "{u:?}: {mean} +- {error}, integrated {albedo}");
        if u.sampler_index == COSINE {
            assert!((mean - 1.0).abs() < 1e-6, "{mean}");
        }
        if u.metallic == 1.0 {
            assert!(mean < 1.0 + 3.0 * error, "{u:?}: {mean}");
        }
    }
}

#[test]
fn smooth_boundaries_reflect_and_refract_by_fresnel_and_snell() {
    let bench = Bench::new();
    for view in VIEWS {
        for (ior, is_thin) in [(1.5, 0), (1.0 / 1.5, 0), (1.33, 1)] {
            let u = DrawUniforms { ior, is_thin, is_delta: 1, ..uniforms(DIELECTRIC, view) };
            let (wo, _) = of_index(&u);
            let drawn = bench.draw(&u);
            let reflected = f64::from(reflectance(&twin_dielectric(&u), wo.z));
            let count = drawn.len() as f64;
            let observed = drawn.iter().filter(|draw| draw.direction[2] > 0.0).count() as f64;
            let sigma = (count * reflected * (1.0 - reflected)).sqrt();
            assert!((observed - count * reflected).abs() <= 4.5 * sigma + 0.5, "{u:?}: {observed} of {count}");
            for draw in &drawn {
                let wi = Vec3::from_array(draw.direction);
                assert_eq!((draw.pdf, draw.evaluated_pdf), (0.0, 0.0), "discrete directions have no density");
                // Tangential parts: mirrored, or scaled by the ratio of the indices; a sheet does not refract.
                let bend = if wi.z > 0.0 || is_thin != 0 { 1.0 } else { ior };
                assert!((wi.truncate() * bend + wo.truncate()).length() < 1e-5 && (wi.length() - 1.0).abs() < 1e-5);
                let expected = if wi.z < 0.0 && is_thin == 0 { 1.0 / (ior * ior) } else { 1.0 };
                assert!((draw.weight[0] - expected).abs() < 1e-5, "{draw:?}");
            }
        }
    }
}
