//! Scenes the project makes itself: a Cornell box and an apartment. Each is written as a GLB and loaded like any other.

mod apartment;
mod cornell;
mod furniture;
mod kitchen;
mod shape;
mod texture;
mod writer;

pub use apartment::interior;
pub use cornell::cornell_box;

/// Name, GLB and view file of a built-in scene.
#[derive(Clone, Debug)]
pub struct DemoScene {
    /// Name people choose it by.
    pub name: &'static str,
    /// The file.
    pub glb: Vec<u8>,
    /// View JSON: cameras, environment, exposure.
    pub view: String,
}

/// All built-in scenes. The same bytes on every call.
pub fn scenes() -> [DemoScene; 2] {
    [
        DemoScene { name: "interior", glb: interior(), view: apartment::view() },
        DemoScene { name: "cornell_box", glb: cornell_box(), view: cornell::view() },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::{any_hit, closest_hit};
    use crate::{LoadOptions, Scene, ViewFile, load_bytes};
    use glam::{DVec3, Vec3};

    fn load(demo: &DemoScene) -> Scene {
        let view = ViewFile::parse(demo.view.as_bytes()).unwrap();
        load_bytes(&demo.glb, demo.name, &LoadOptions { view: Some(view), ..LoadOptions::default() }).unwrap()
    }

    #[test]
    fn demo_scenes_load_without_warnings() {
        for demo in scenes() {
            let started = std::time::Instant::now();
            let scene = load(&demo);
            println!(
                "{}: {} bytes, {} triangles, {} emissive, load {:.2} s",
                demo.name,
                demo.glb.len(),
                scene.summary.triangle_count,
                scene.summary.emissive_triangle_count,
                started.elapsed().as_secs_f64()
            );
            assert_eq!(scene.warnings, Vec::<String>::new(), "{}", demo.name);
            assert!(demo.glb.len() < 4 << 20);
            assert!(scene.summary.emissive_triangle_count > 0);
        }
    }

    #[test]
    fn the_same_bytes_come_out_every_time() {
        for (a, b) in scenes().into_iter().zip(scenes()) {
            assert!(a.glb == b.glb && a.view == b.view, "{}", a.name);
        }
    }

    #[test]
    fn the_interior_is_rich_and_its_cameras_see_it() {
        let scene = load(&scenes()[0]);
        assert!((50_000..150_000).contains(&scene.summary.triangle_count), "{}", scene.summary.triangle_count);
        let summary = scene.summary;
        assert!(summary.has_textures && summary.has_transmission && summary.has_environment);
        assert!(summary.punctual_light_count > 0 && scene.cameras.len() >= 3);
        for named in &scene.cameras {
            let camera = &named.camera;
            let (right, up, forward) = camera.frame();
            let mut distances = Vec::new();
            for k in 0..400 {
                let (x, y) = ((k % 20) as f64 / 10.0 - 0.95, (k / 20) as f64 / 10.0 - 0.95);
                let spread = (camera.vfov / 2.0).tan();
                let direction = (forward + right * (x * spread * 1.5) + up * (y * spread)).as_vec3();
                let eye = (camera.position - scene.origin).as_vec3();
                if let Some(hit) = closest_hit(&scene.geometry, eye, direction, 0.0, f32::INFINITY) {
                    distances.push(hit.t * direction.length());
                }
            }
            assert!(distances.len() > 340, "{}: {} of 400 rays hit something", named.name, distances.len());
            let near = distances.iter().filter(|&&t| t < 0.3).count();
            assert!(near < 40, "{}: {near} of 400 rays end right before the camera", named.name);
        }
    }

    /// From inside a room every way out leads through an opening: straight up and down there is none.
    #[test]
    fn rooms_are_closed_above_and_below_and_the_sun_comes_in() {
        let scene = load(&scenes()[0]);
        let local = |x: f64, y: f64, z: f64| (DVec3::new(x, y, z) - scene.origin).as_vec3();
        let sun = &scene.punctual_lights[0];
        let (mut lit, mut total) = (0, 0);
        for i in 0..40 {
            for j in 0..32 {
                let p = local(0.1 + f64::from(i) * 0.145, 1.25, 0.1 + f64::from(j) * 0.15);
                assert!(any_hit(&scene.geometry, p, Vec3::Y, 0.0, 4.0), "open above {p}");
                assert!(any_hit(&scene.geometry, p, -Vec3::Y, 0.0, 4.0), "open below {p}");
                lit += u32::from(!any_hit(&scene.geometry, p, -sun.direction, 0.0, 100.0));
                total += 1;
            }
        }
        assert!(lit > total / 40, "the sun reaches {lit} of {total} points");
    }
}
