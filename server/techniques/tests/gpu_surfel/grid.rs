//! Both grids find the same surfels, which give the same light.

use surfelcast_gpu::Gpu;
use surfelcast_scene::{Camera, Scene};
use surfelcast_techniques::surfel::{ENTRY, Grid, SurfelSettings, cache_of};
use surfelcast_techniques::{Change, SessionState, SnapshotIdentity};

use crate::rig::{Rig, camera, gpu};
use crate::scenes::{Face, Paint, inside_of_box, scene};

const SIZE: [u32; 2] = [96, 72];
const IDENTITY: SnapshotIdentity = SnapshotIdentity { scene: [3; 32], lights: [4; 32] };
// Restored surfels have met this error goal, and newly visible surfaces are lit without the cache, so that every
// difference between two images is one of the gathers.
const SETTINGS: SurfelSettings =
    SurfelSettings { target_error: 0.1, radius_pixels: 3.0, feeds_back: false, ..SurfelSettings::BALANCED };

/// A room with a pillar: surfels of several sizes, near and far.
fn room() -> Vec<Face> {
    let mut faces = inside_of_box([-1.0, -1.0, -4.0], [1.0, 1.0, 2.0], Paint::matte(0.7));
    let pillar = inside_of_box([-0.6, -1.0, -2.2], [-0.2, 1.0, -1.8], Paint::matte(0.5));
    faces.extend(pillar.into_iter().map(|(corners, paint)| (corners.into_iter().rev().collect(), paint)));
    for z in [-3.0, -0.5f32] {
        let (near, far) = (z + 0.3, z - 0.3);
        faces
            .push((vec![[-0.3, 0.98, far], [0.3, 0.98, far], [0.3, 0.98, near], [-0.3, 0.98, near]], Paint::lamp(5.0)));
    }
    faces
}

fn near_view() -> Camera {
    camera([0.6, 0.2, 1.2], [-0.2, -0.4, -3.0])
}

fn side_view() -> Camera {
    camera([-0.5, -0.4, 0.5], [0.4, 0.3, -3.0])
}

/// A snapshot of a cache that a camera has filled.
fn filled(gpu: &Gpu, scene: &Scene) -> Vec<u8> {
    let rig = Rig::new(gpu, scene, SETTINGS, SIZE);
    let mut picture = rig.picture();
    rig.frames(picture.as_mut(), near_view(), 48);
    let cache = cache_of(&rig.session).unwrap();
    cache.lock().save(gpu, &IDENTITY).unwrap()
}

/// Irradiance over pi at each pixel from a restored cache, and its number of surfels.
fn gathered(gpu: &Gpu, scene: &Scene, bytes: &[u8], grid: Grid, view: Camera) -> (Vec<[f32; 4]>, u32) {
    let mut rig = Rig::new(gpu, scene, SurfelSettings { grid, ..SETTINGS }, SIZE);
    rig.session = SessionState::default();
    rig.session.of(&ENTRY).restore(IDENTITY, bytes.to_vec());
    let mut picture = rig.picture();
    rig.frames(picture.as_mut(), view, 1);
    let (_, irradiance) = picture.split().unwrap();
    (rig.read(irradiance), picture.occupancy().unwrap()[0])
}

#[test]
fn both_grids_find_the_same_light_in_the_same_surfels() {
    let gpu = gpu();
    let scene = scene(&room(), 0.0);
    let bytes = filled(&gpu, &scene);
    // Where the camera was, a little to the side, and among surfels that are too coarse for it. No cell may be so full
    // that it would be thinned.
    for view in [near_view(), side_view(), camera([0.0, -0.5, -2.5], [0.3, -0.9, -3.5])] {
        let (cascades, count) = gathered(&gpu, &scene, &bytes, Grid::Cascades, view);
        let (trapezoidal, same_count) = gathered(&gpu, &scene, &bytes, Grid::Trapezoidal, view);
        assert_eq!(count, same_count, "coverage differs, so other surfels were spawned");
        let mut worst = 0.0f32;
        let mut lit = 0;
        for (a, b) in cascades.iter().zip(&trapezoidal) {
            worst = worst.max((a[0] - b[0]).abs() / a[0].abs().max(1e-3));
            lit += u32::from(a[0] > 0.0);
        }
        println!("{count} surfels, {lit} lit pixels, worst relative difference {worst:.2e}");
        assert!(lit > SIZE[0] * SIZE[1] / 2, "{lit}");
        assert!(worst < 1e-4, "{worst}");
    }
}

/// Ray hits look surfels up in the grid, so whole updates agree too.
#[test]
fn the_trapezoidal_grid_follows_a_moving_camera() {
    let gpu = gpu();
    let scene = scene(&room(), 0.0);
    let walk = |grid| {
        let settings = SurfelSettings { grid, target_error: 0.0, feeds_back: true, ..SETTINGS };
        let rig = Rig::new(&gpu, &scene, settings, SIZE);
        let mut picture = rig.picture();
        for step in [0, 1, 2, 3, 4, 5, 6, 7, 0, 7] {
            picture.invalidate(Change::Camera);
            let z = 1.2 - 0.3 * f64::from(step);
            rig.frames(picture.as_mut(), camera([0.6, 0.2, z], [-0.2, -0.4, z - 4.0]), 2);
        }
        let (_, irradiance) = picture.split().unwrap();
        let sum = rig.read(irradiance).iter().map(|b| f64::from(b[0])).sum::<f64>();
        (sum, picture.occupancy().unwrap()[0])
    };
    let (cascades, count) = walk(Grid::Cascades);
    let (trapezoidal, other_count) = walk(Grid::Trapezoidal);
    println!("sum of irradiance over pi {cascades:.4} and {trapezoidal:.4}, {count} and {other_count} surfels");
    // Rounding may change a few paths.
    assert!((trapezoidal / cascades - 1.0).abs() < 1e-3);
    assert!(count.abs_diff(other_count) <= count / 200);
}
