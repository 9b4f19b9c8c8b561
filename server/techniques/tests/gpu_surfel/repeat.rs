//! The same request gives the same bytes.

use surfelcast_scene::{LoadOptions, ViewFile, demo, load_bytes};
use surfelcast_techniques::Change;
use surfelcast_techniques::surfel::{SurfelSettings, cache_of};

use crate::rig::{Rig, camera, gpu};
use crate::scenes::{Paint, inside_of_box, scene};

#[test]
fn two_hundred_frames_of_a_moving_camera_repeat_to_the_bit() {
    let gpu = gpu();
    let scenes = demo::scenes();
    let demo = scenes.iter().find(|demo| demo.name == "cornell_box").unwrap();
    let view = ViewFile::parse(demo.view.as_bytes()).unwrap();
    let scene = load_bytes(&demo.glb, demo.name, &LoadOptions { view: Some(view), ..LoadOptions::default() }).unwrap();
    let walk = |paths: u64| {
        let rig = Rig::new(&gpu, &scene, SurfelSettings::BALANCED, [40, 32]);
        let mut picture = rig.picture();
        let mut frames = Vec::new();
        for frame in 0..200 {
            let angle = f64::from(frame) * 0.02;
            let at = camera([0.6 * angle.cos(), 1.0 + 0.3 * (2.0 * angle).sin(), 0.8 * angle.sin()], [0.0, 0.7, 0.0]);
            picture.invalidate(Change::Camera);
            rig.frames_in_pieces(picture.as_mut(), at, 1, paths);
            frames.push(rig.read(picture.picture()));
        }
        frames
    };
    let whole = walk(u64::MAX);
    // The size of the pieces follows the clock in the server, so it must not change the result.
    let in_pieces = walk(1500);
    for (frame, (a, b)) in whole.iter().zip(&in_pieces).enumerate() {
        assert!(a == b, "frame {frame} differs");
    }
    assert!(whole[0] != whole[199]);
}

#[test]
fn a_full_cache_keeps_working_and_stays_finite() {
    let gpu = gpu();
    let scene = scene(&inside_of_box([-1.0; 3], [1.0; 3], Paint { albedo: 0.5, emission: 0.5, is_unlit: false }), 0.0);
    // Far more surfels are requested than fit.
    let settings = SurfelSettings { capacity: 65_536, radius_pixels: 1.5, coverage: 2.0, ..SurfelSettings::BALANCED };
    let rig = Rig::new(&gpu, &scene, settings, [512, 512]);
    let mut picture = rig.picture();
    let view = camera([0.1, 0.05, 0.2], [0.9, 0.2, -0.6]);
    let serials = || {
        let cache = cache_of(&rig.session).unwrap();
        let surfels = cache.lock().export(&gpu).unwrap();
        surfels.iter().map(|surfel| surfel.record.serial).collect::<Vec<_>>()
    };
    rig.frames(picture.as_mut(), view, 4);
    let [live, capacity] = picture.occupancy().unwrap();
    println!("{live} of {capacity} surfels");
    assert_eq!(live, capacity);
    let before = serials();
    rig.frames(picture.as_mut(), view, 8);
    // More are requested in every frame; none may overwrite one that is in use.
    assert!(serials() == before, "a surfel in use was overwritten");
    assert!(rig.values(picture.as_ref()).iter().all(|value| value.is_finite() && *value < 4.0));
}
