//! Light stays in the room it is in.

use crate::rig::{Rig, camera, gpu, mean};
use crate::scenes::{Face, Paint, inside_of_box, scene};
use surfelcast_techniques::surfel::SurfelSettings;

/// Two rooms with a common floor and ceiling and a thin wall between them; a lamp in the left one.
fn two_rooms() -> Vec<Face> {
    let mut faces = inside_of_box([-2.0, 0.0, -1.0], [2.0, 2.0, 1.0], Paint::matte(0.8));
    for (x, is_left) in [(-0.01, true), (0.01, false)] {
        let wall = [[x, 0.0, -1.0], [x, 2.0, -1.0], [x, 2.0, 1.0], [x, 0.0, 1.0f32]];
        let corners = if is_left { wall.iter().rev().copied().collect() } else { wall.to_vec() };
        faces.push((corners, Paint::matte(0.8)));
    }
    faces.push((vec![[-1.3, 1.98, -0.3], [-0.7, 1.98, -0.3], [-0.7, 1.98, 0.3], [-1.3, 1.98, 0.3]], Paint::lamp(4.0)));
    faces
}

fn light_in_the_dark(settings: SurfelSettings, seed: u64) -> f64 {
    let gpu = gpu();
    let scene = scene(&two_rooms(), 0.0);
    let rig = Rig::new(&gpu, &scene, settings, [64, 48]);
    let mut lit = rig.picture_by("surfel", seed);
    let mut dark = rig.picture_by("surfel", seed);
    // Both cameras see the floor along the wall, where surfels of the lit side overlap it.
    for _ in 0..3 {
        lit.invalidate(surfelcast_techniques::Change::Camera);
        dark.invalidate(surfelcast_techniques::Change::Camera);
        rig.frames(lit.as_mut(), camera([-1.6, 1.4, 0.5], [-0.1, 0.0, 0.0]), 16);
        rig.frames(dark.as_mut(), camera([1.6, 1.4, 0.5], [0.1, 0.0, 0.0]), 16);
    }
    mean(&rig.values(dark.as_ref())) / mean(&rig.values(lit.as_ref()))
}

#[test]
fn a_dark_room_next_to_a_lit_one_stays_dark() {
    // The value depends on single surfels next to the wall.
    let draws = [5, 6, 7, 8].map(|seed| light_in_the_dark(SurfelSettings::BALANCED, seed));
    let with_depth = draws.iter().sum::<f64>() / draws.len() as f64;
    let without = light_in_the_dark(SurfelSettings { respects_depth: false, ..SurfelSettings::BALANCED }, 5);
    println!("dark room over lit room: {with_depth:.2e} of {draws:.5?}, without radial depth {without:.2e}");
    assert!(with_depth < 1e-3, "{with_depth}");
    assert!(without > with_depth, "the scene does not test radial depth any more");
}
