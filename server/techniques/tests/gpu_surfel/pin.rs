//! What a view pins stays, however many surfels other views need.

use std::collections::BTreeSet;

use surfelcast_gpu::Gpu;
use surfelcast_techniques::surfel::{Reconstruction, SurfelSettings, cache_of};
use surfelcast_techniques::{Change, SessionState, Technique};

use crate::rig::{Rig, camera, gpu};
use crate::scenes::{Face, Paint, inside_of_box, scene};

const SMALL: [u32; 2] = [48, 48];
const LARGE: [u32; 2] = [576, 576];
// Rays are not served from the cache, so that the surfels of a room do not keep each other in use. The large image
// requests more surfels than fit.
const SETTINGS: SurfelSettings = SurfelSettings {
    capacity: 65_536,
    radius_pixels: 1.5,
    coverage: 2.0,
    target_error: 0.0,
    reconstruction: Reconstruction::None,
    feeds_back: false,
    ..SurfelSettings::BALANCED
};

/// Two closed rooms, neither of which is visible from the other.
fn two_rooms() -> Vec<Face> {
    let glow = Paint { albedo: 0.5, emission: 0.5, is_unlit: false };
    let mut faces = inside_of_box([-3.0, -1.0, -1.0], [-1.0, 1.0, 1.0], glow);
    faces.extend(inside_of_box([1.0, -1.0, -1.0], [3.0, 1.0, 1.0], glow));
    faces
}

fn picture(rig: &mut Rig<'_>, size: [u32; 2], pins: bool) -> Box<dyn Technique> {
    (rig.size, rig.full_size) = (size, size);
    rig.settings = SurfelSettings { pins, ..SETTINGS };
    rig.picture()
}

fn serials(gpu: &Gpu, session: &SessionState) -> BTreeSet<u32> {
    let cache = cache_of(session).unwrap();
    let surfels = cache.lock().export(gpu).unwrap();
    surfels.iter().map(|surfel| surfel.record.serial).collect()
}

#[test]
fn pinned_surfels_outlive_a_cache_full_of_others() {
    let gpu = gpu();
    let scene = scene(&two_rooms(), 0.0);
    let mut rig = Rig::new(&gpu, &scene, SETTINGS, SMALL);
    let mut left = picture(&mut rig, SMALL, true);
    rig.frames(left.as_mut(), camera([-2.0, 0.0, 0.5], [-2.0, 0.0, -1.0]), 1);
    let pinned = serials(&gpu, &rig.session);
    let elsewhere = camera([2.0, 0.0, 0.5], [2.0, 0.0, -1.0]);
    let mut right = picture(&mut rig, LARGE, false);
    let is_full = |picture: &dyn Technique| picture.occupancy().is_some_and(|[live, capacity]| live == capacity);
    for _ in 0..8 {
        if !is_full(right.as_ref()) {
            right.invalidate(Change::Camera);
            rig.frames(right.as_mut(), elsewhere, 1);
        }
    }
    assert!(is_full(right.as_ref()), "{:?}", right.occupancy());
    // Many updates later, when surfels out of sight are due for recycling several times over.
    let mut small = picture(&mut rig, SMALL, false);
    rig.frames(small.as_mut(), elsewhere, 110);
    let stay = pinned.intersection(&serials(&gpu, &rig.session)).count();
    // Nothing else kept them: without the pinning view they are recycled.
    drop(left);
    rig.frames(small.as_mut(), elsewhere, 140);
    let stay_unpinned = pinned.intersection(&serials(&gpu, &rig.session)).count();
    println!("of {} surfels {stay} stay while pinned, {stay_unpinned} thirty updates after that", pinned.len());
    assert!(pinned.len() > 100 && stay == pinned.len(), "{stay} of {}", pinned.len());
    assert!(stay_unpinned < stay * 3 / 4, "{stay_unpinned} of {stay}");
}
