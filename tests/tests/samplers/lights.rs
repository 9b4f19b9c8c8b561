//! Next-event estimation on the device: its mean against integrals over the lights, its density against the density
//! that BSDF sampling uses for multiple importance sampling.

use std::f64::consts::{FRAC_1_SQRT_2, PI};
use std::sync::Arc;

use glam::{DVec3, Vec3};
use serde_json::{Value, json};
use surfelcast_gpu::{Gpu, Kernel};
use surfelcast_scene::glb::GlbBuilder;
use surfelcast_scene::{Environment, EnvironmentMap, LoadOptions, PunctualKind, Scene, load_bytes};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::twin::scene::environment::{environment_texel, environment_uv};
use surfelcast_techniques::{LightBuffers, LightState, SceneBuffers};

use crate::device;
use crate::statistics::{Suite, chi_square, mean_and_error};

const COUNT: u32 = 1 << 19;

mod records {
    surfelcast_shaders::gpu_structs! {
        /// As in the kernel.
        pub struct LightUniforms {
            /// Shaded point, scene space.
            pub position: [f32; 3],
            /// Samples.
            pub count: u32,
            /// Part of the table.
            pub triangle_count: u32,
            /// Part of the table.
            pub punctual_count: u32,
            /// Part of the table.
            pub environment_count: u32,
            /// Factor.
            pub emission_scale: f32,
            /// Texels.
            pub environment_size: [u32; 2],
            /// Factor.
            pub environment_scale: f32,
            /// Metres.
            pub scene_radius: f32,
            /// Seed.
            pub seed: [u32; 2],
            /// Root.
            pub top_root: u32,
            /// Grid instead of samples.
            pub grid_columns: u32,
        }

        /// As in the kernel.
        pub struct DrawnLight {
            /// Vector to the light.
            pub to_light: [f32; 3],
            /// Density.
            pub pdf: f32,
            /// Radiance over density.
            pub weight: [f32; 3],
            /// Whether it is valid.
            pub is_valid: u32,
            /// Unit vector.
            pub direction: [f32; 3],
            /// Density as of BSDF sampling.
            pub other_pdf: f32,
        }
    }
}
use records::{DrawnLight, LightUniforms};

struct Bench {
    gpu: Gpu,
    kernel: Kernel,
    scene: Scene,
    buffers: SceneBuffers,
    lights: LightBuffers,
}

impl Bench {
    fn new(scene: Scene, features: Features) -> Self {
        let gpu = device::gpu();
        let kernel = gpu.kernel_from_source("draw_lights", include_str!("draw_lights.wesl"), features);
        let kernel = kernel.unwrap_or_else(|error| panic!("{error}"));
        let differences = surfelcast_shaders::layout::differences(&records::structs(), kernel.reflection());
        assert!(differences.is_empty(), "{differences:?}");
        let buffers = SceneBuffers::new(&gpu, &scene).expect("fits");
        let lights = LightBuffers::new(&gpu, &scene, &LightState::of_scene(&scene)).expect("fits");
        Bench { gpu, kernel, scene, buffers, lights }
    }

    fn draw(&self, position: Vec3, count: u32, grid_columns: u32) -> Vec<DrawnLight> {
        let uniforms = LightUniforms {
            position: position.to_array(),
            count,
            triangle_count: self.lights.triangle_count,
            punctual_count: self.lights.punctual_count,
            environment_count: self.lights.environment_count,
            emission_scale: self.lights.emission_scale,
            environment_size: self.buffers.environment_size,
            environment_scale: self.lights.environment_scale,
            scene_radius: self.buffers.radius,
            seed: [29, 31],
            top_root: self.scene.geometry.instances.first().map_or(0, |instance| instance.root_node),
            grid_columns,
        };
        device::run(&self.gpu, &self.kernel, "drawn", count, |pass| {
            self.lights.bind(self.buffers.bind(pass)).uniform("draw", bytemuck::bytes_of(&uniforms))
        })
    }

    /// Mean of the estimator of irradiance on a plane facing `normal`, and its standard error.
    fn irradiance(&self, position: Vec3, normal: Vec3) -> (f64, f64) {
        let drawn = self.draw(position, COUNT, 0);
        mean_and_error(drawn.iter().map(|draw| {
            let cosine = Vec3::from_array(draw.direction).dot(normal).max(0.0);
            if draw.is_valid == 0 { 0.0 } else { f64::from(draw.weight[1] * cosine) }
        }))
    }
}

/// Three emissive triangles of different size and radiance that face the origin from several sides, and one that faces
/// away.
fn emitters(glb: &mut GlbBuilder) {
    let lamps: [([[f32; 3]; 3], f32); 4] = [
        ([[-1.0, 2.0, -1.0], [1.0, 2.0, -1.0], [0.0, 2.2, 1.0]], 3.0),
        ([[2.0, 0.5, -0.2], [2.0, 0.7, 0.2], [2.1, 1.0, -0.1]], 40.0),
        ([[-3.0, 0.2, -2.0], [-3.0, 0.2, 2.0], [-3.0, 3.0, 0.0]], 0.2),
        ([[-1.0, 3.0, -1.0], [0.0, 3.2, 1.0], [1.0, 3.0, -1.0]], 5.0),
    ];
    for (corners, radiance) in lamps {
        let emission = json!({"emissiveFactor": [1, 1, 1], "extensions": {
            "KHR_materials_emissive_strength": {"emissiveStrength": radiance}}});
        let material = glb.push("materials", emission);
        let position = glb.floats(&corners);
        let indices = glb.indices(&[[0, 1, 2]]);
        let primitive = json!({"attributes": {"POSITION": position}, "indices": indices, "material": material});
        let mesh = glb.push("meshes", json!({"primitives": [primitive]}));
        glb.root_node(json!({"mesh": mesh}));
    }
    glb.use_extension("KHR_materials_emissive_strength");
}

fn punctual(glb: &mut GlbBuilder, lights: &[(Value, Value)]) {
    let list: Vec<Value> = lights.iter().map(|(light, _)| light.clone()).collect();
    glb.set("extensions", json!({"KHR_lights_punctual": {"lights": list}}));
    glb.use_extension("KHR_lights_punctual");
    for (index, (_, node)) in lights.iter().enumerate() {
        let mut node = node.clone();
        node["extensions"] = json!({"KHR_lights_punctual": {"light": index}});
        glb.root_node(node);
    }
}

fn some_punctual(glb: &mut GlbBuilder) {
    punctual(
        glb,
        &[
            (json!({"type": "point", "intensity": 7.0}), json!({"translation": [0.5, 1.5, 0.5]})),
            (json!({"type": "point", "intensity": 90.0, "range": 0.5}), json!({"translation": [0.0, 1.9, 0.0]})),
            (
                json!({"type": "spot", "intensity": 20.0, "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.9}}),
                // Shines along its -Z: rotated downwards, not quite at the point.
                json!({"translation": [0.4, 1.8, 0.0], "rotation": [-FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2]}),
            ),
            (json!({"type": "directional", "intensity": 2.0}), json!({"rotation": [-0.5, 0.0, 0.0, 0.866_025_4]})),
        ],
    );
}

fn environment() -> Environment {
    let (width, height) = (16, 8);
    let radiance = (0..width * height)
        .map(|index: u32| {
            let [x, y] = [index % width, index / width];
            let sun = if (x, y) == (5, 2) { 60.0 } else { 0.0 };
            [0.1 + 0.05 * (x * y % 7) as f32 + sun; 3]
        })
        .collect();
    Environment::Map(Arc::new(EnvironmentMap { width, height, radiance }))
}

fn scene(build: impl FnOnce(&mut GlbBuilder)) -> Scene {
    let mut glb = GlbBuilder::new();
    build(&mut glb);
    load_bytes(&glb.finish(), "lights", &LoadOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// World position in scene space.
fn place(scene: &Scene, world: DVec3) -> Vec3 {
    (world - scene.origin).as_vec3()
}

/// Irradiance by quadrature over the triangles, scene space.
fn triangle_irradiance(scene: &Scene, position: Vec3, normal: Vec3) -> f64 {
    const STEPS: u32 = 200;
    let mut sum = 0.0;
    for light in &scene.emissive_triangles {
        let [a, b, c] = light.corners.map(Vec3::as_dvec3);
        let face = (b - a).cross(c - a);
        let cell_area = face.length() * 0.5 / f64::from(STEPS * STEPS);
        for row in 0..STEPS {
            for column in 0..=2 * row {
                // Centroids of a regular subdivision: upright and inverted cells alternate.
                let (up, k) = (column % 2 == 0, column / 2);
                let (v, w) = if up { (1.0 / 3.0, 1.0 / 3.0) } else { (2.0 / 3.0, 2.0 / 3.0) };
                let (i, j) = (f64::from(row - k) - if up { 0.0 } else { 1.0 } + v, f64::from(k) + w);
                let point = a + (b - a) * (i / f64::from(STEPS)) + (c - a) * (j / f64::from(STEPS));
                let to_light = point - position.as_dvec3();
                let direction = to_light.normalize_or_zero();
                let cosines =
                    normal.as_dvec3().dot(direction).max(0.0) * (-face.normalize_or_zero().dot(direction)).max(0.0);
                sum += f64::from(light.mean_radiance[1]) * cosines / to_light.length_squared() * cell_area;
            }
        }
    }
    sum
}

fn punctual_irradiance(scene: &Scene, position: Vec3, normal: Vec3) -> f64 {
    let mut sum = 0.0;
    for light in &scene.punctual_lights {
        let intensity = f64::from(light.intensity[1]);
        let to_light = light.position - position;
        let direction = to_light.normalize_or_zero();
        let facing = f64::from(normal.dot(direction).max(0.0));
        let square = f64::from(to_light.length_squared());
        let in_range = to_light.length() <= light.range;
        sum += match light.kind {
            PunctualKind::Directional => intensity * f64::from(normal.dot(-light.direction).max(0.0)),
            _ if !in_range => 0.0,
            PunctualKind::Point => intensity * facing / square,
            PunctualKind::Spot { inner_angle, outer_angle } => {
                let cosine = (-direction).dot(light.direction);
                let ramp = (cosine - outer_angle.cos()) / (inner_angle.cos() - outer_angle.cos());
                intensity * facing / square * f64::from(ramp.clamp(0.0, 1.0).powi(2))
            }
        };
    }
    sum
}

/// Bilinear radiance of an image in a direction, as a viewer sees it.
fn radiance(map: &EnvironmentMap, direction: Vec3) -> f64 {
    let uv = environment_uv(direction);
    let (x, y) = (uv.x * map.width as f32 - 0.5, uv.y * map.height as f32 - 0.5);
    let texel = |column: f32, row: f32| {
        let column = (column as i64).rem_euclid(i64::from(map.width)) as usize;
        let row = (row as i64).clamp(0, i64::from(map.height) - 1) as usize;
        f64::from(map.radiance[row * map.width as usize + column][1])
    };
    let (fx, fy) = (f64::from(x - x.floor()), f64::from(y - y.floor()));
    let row = |y: f32| texel(x.floor(), y) * (1.0 - fx) + texel(x.floor() + 1.0, y) * fx;
    row(y.floor()) * (1.0 - fy) + row(y.floor() + 1.0) * fy
}

fn environment_irradiance(map: &EnvironmentMap, normal: Vec3) -> f64 {
    const ROWS: u32 = 800;
    let mut sum = 0.0;
    for row in 0..ROWS {
        let theta = (f64::from(row) + 0.5) / f64::from(ROWS) * PI;
        for column in 0..2 * ROWS {
            let phi = (f64::from(column) + 0.5) / f64::from(ROWS) * PI;
            let w = DVec3::new(theta.sin() * phi.sin(), theta.cos(), theta.sin() * phi.cos()).as_vec3();
            sum += radiance(map, w) * f64::from(w.dot(normal).max(0.0)) * theta.sin();
        }
    }
    sum * (PI / f64::from(ROWS)).powi(2)
}

fn expect(what: &str, (mean, error): (f64, f64), expected: f64) {
    assert!(expected > 0.0 && error < 0.05 * expected, "{what}: {mean} +- {error}, expected {expected}: says nothing");
    assert!((mean - expected).abs() < 4.5 * error + 2e-3 * expected, "{what}: {mean} +- {error}, expected {expected}");
}

const NORMALS: [Vec3; 3] = [Vec3::Y, Vec3::new(0.6, 0.8, 0.0), Vec3::new(-0.6, 0.48, 0.64)];

#[test]
fn emissive_triangles_give_their_irradiance() {
    let bench = Bench::new(scene(emitters), Features::EMISSIVE_TRIANGLES);
    assert_eq!(bench.lights.triangle_count, 4);
    let position = place(&bench.scene, DVec3::ZERO);
    for normal in NORMALS {
        expect("triangles", bench.irradiance(position, normal), triangle_irradiance(&bench.scene, position, normal));
    }
}

#[test]
fn punctual_lights_give_their_irradiance() {
    let bench = Bench::new(scene(some_punctual), Features::PUNCTUAL_LIGHTS);
    assert_eq!(bench.lights.punctual_count, 4);
    let position = place(&bench.scene, DVec3::ZERO);
    for normal in NORMALS {
        expect("punctual", bench.irradiance(position, normal), punctual_irradiance(&bench.scene, position, normal));
    }
}

#[test]
fn an_environment_image_gives_its_irradiance_and_its_density_is_what_is_drawn() {
    let mut sky = scene(some_punctual);
    sky.punctual_lights.clear();
    sky.environment = environment();
    let Environment::Map(map) = sky.environment.clone() else { unreachable!("built as an image") };
    let bench = Bench::new(sky, Features::ENVIRONMENT);
    assert_eq!(bench.lights.environment_count, 1);
    for normal in NORMALS {
        expect("environment", bench.irradiance(Vec3::ZERO, normal), environment_irradiance(&map, normal));
    }
    // The density integrates to one on a fine grid. Inside a texel it is proportional to 1 / sin(theta), so the mean of
    // their product is the probability of the texel, which is compared with the histogram.
    let (rows, columns) = (512, 1024);
    let grid = bench.draw(Vec3::ZERO, rows * columns, columns);
    let integral = grid.iter().map(|point| f64::from(point.pdf)).sum::<f64>() * 4.0 * PI / f64::from(rows * columns);
    assert!((integral - 1.0).abs() < 5e-3, "the density integrates to {integral}");
    let size = [map.width, map.height];
    let texel_count = f64::from(map.width * map.height);
    let mut sums = vec![(0.0, 0.0); texel_count as usize];
    for point in &grid {
        let direction = Vec3::from_array(point.direction);
        let sin_theta = f64::from(1.0 - direction.y * direction.y).sqrt();
        let (sum, points) = &mut sums[environment_texel(size, direction)];
        *sum += f64::from(point.pdf) * sin_theta * 2.0 * PI * PI / texel_count;
        *points += 1.0;
    }
    let mut expected: Vec<f64> = sums.iter().map(|(sum, points)| sum / points).collect();
    let sum: f64 = expected.iter().sum();
    assert!((sum - 1.0).abs() < 5e-3, "the texels' probabilities add up to {sum}");
    let mut observed = vec![0.0; expected.len()];
    let drawn = bench.draw(Vec3::ZERO, COUNT, 0);
    let mut at_poles = 0;
    for draw in &drawn {
        // At a pole the density is undefined.
        if draw.is_valid == 0 {
            at_poles += 1;
            continue;
        }
        assert!((draw.pdf - draw.other_pdf).abs() <= 1e-3 * draw.pdf, "{draw:?}");
        observed[environment_texel(size, Vec3::from_array(draw.direction))] += 1.0;
    }
    assert!(at_poles <= 4, "{at_poles} draws came to nothing");
    for value in &mut expected {
        *value *= f64::from(COUNT) / sum;
    }
    let mut suite = Suite::default();
    suite.add("environment".to_owned(), chi_square(&observed, &expected));
    suite.judge();
}

#[test]
fn all_kinds_together_add_up_and_both_strategies_state_one_density() {
    let mut all = scene(|glb| {
        emitters(glb);
        some_punctual(glb);
    });
    all.environment = environment();
    let Environment::Map(map) = all.environment.clone() else { unreachable!("built as an image") };
    let features = Features::EMISSIVE_TRIANGLES | Features::PUNCTUAL_LIGHTS | Features::ENVIRONMENT;
    // The specialised variant and the general one give the same samples.
    let drawn: Vec<Vec<DrawnLight>> = [features, features | Features::TEXTURES | Features::PBR]
        .map(|features| {
            let mut again = scene(|glb| {
                emitters(glb);
                some_punctual(glb);
            });
            again.environment = environment();
            let bench = Bench::new(again, features);
            bench.draw(place(&bench.scene, DVec3::ZERO), COUNT, 0)
        })
        .into();
    for (special, general) in drawn[0].iter().zip(&drawn[1]) {
        assert_eq!((special.is_valid, special.direction), (general.is_valid, general.direction));
    }

    let bench = Bench::new(all, features);
    let position = place(&bench.scene, DVec3::ZERO);
    for normal in NORMALS {
        // Each light alone, without occluders: light sampling does not test visibility.
        let expected = triangle_irradiance(&bench.scene, position, normal)
            + punctual_irradiance(&bench.scene, position, normal)
            + environment_irradiance(&map, normal);
        expect("all", bench.irradiance(position, normal), expected);
    }
    let mut compared = [0; 2];
    for draw in bench.draw(position, COUNT, 0).iter().filter(|draw| draw.is_valid == 1 && draw.pdf > 0.0) {
        let is_far = Vec3::from_array(draw.to_light).length() > 3.9 * bench.buffers.radius;
        // A triangle in front of the environment or of another triangle was hit instead.
        if (draw.pdf - draw.other_pdf).abs() <= 2e-3 * draw.pdf {
            compared[usize::from(is_far)] += 1;
        } else {
            assert!(is_far, "{draw:?}");
        }
    }
    assert!(compared.iter().all(|&count| count > COUNT / 50), "{compared:?}");
}
