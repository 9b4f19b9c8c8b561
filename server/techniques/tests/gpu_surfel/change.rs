//! Lights change, cameras are added and removed, and a converged cache costs nothing.

use surfelcast_passes::step::StepBudget;
use surfelcast_techniques::surfel::{SurfelSettings, cache_of};
use surfelcast_techniques::technique::Technique;
use surfelcast_techniques::{Change, FrameView, LightBuffers, LightState};

use crate::rig::{Rig, camera, gpu, mean, rmse};
use crate::scenes::{Face, Paint, inside_of_box, scene};

fn lit_room() -> Vec<Face> {
    let mut faces = inside_of_box([-1.0; 3], [1.0; 3], Paint::matte(0.7));
    faces.push((vec![[-0.3, 0.98, -0.3], [0.3, 0.98, -0.3], [0.3, 0.98, 0.3], [-0.3, 0.98, 0.3]], Paint::lamp(5.0)));
    faces
}

#[test]
fn three_times_the_light_is_shown_within_a_few_frames() {
    let gpu = gpu();
    let scene = scene(&lit_room(), 0.0);
    let settings = SurfelSettings { target_error: 0.0, ..SurfelSettings::BALANCED };
    let mut rig = Rig::new(&gpu, &scene, settings, [48, 48]);
    let view = camera([0.6, 0.2, 0.8], [-0.4, -0.3, -0.5]);
    let mut picture = rig.picture();
    rig.frames(picture.as_mut(), view, 64);
    let indirect = |rig: &Rig<'_>, picture: &dyn Technique| {
        let (direct, _) = picture.split().unwrap();
        mean(&rig.values(picture)) - mean(&rig.read(direct).iter().map(|v| v[0]).collect::<Vec<_>>())
    };
    let before = indirect(&rig, picture.as_ref());
    let state = LightState { emissive_strength: 3.0, ..LightState::of_scene(&scene) };
    rig.lights = LightBuffers::new(&gpu, &scene, &state).unwrap();
    rig.session.invalidate(Change::Lights);
    picture.invalidate(Change::Lights);
    let mut frames_needed = 0;
    for frame in 1..=40 {
        // Each frame by itself, as it is shown.
        picture.invalidate(Change::Camera);
        rig.frames(picture.as_mut(), view, 1);
        let share = (indirect(&rig, picture.as_ref()) - before) / (2.0 * before);
        if share < 0.9 {
            frames_needed = frame + 1;
        }
    }
    let share = (indirect(&rig, picture.as_ref()) - before) / (2.0 * before);
    println!("90 % of the step after {frames_needed} frames, {share:.3} of it after 40");
    assert!(frames_needed <= 6, "{frames_needed} frames");
    assert!((0.97..1.03).contains(&share), "{share}");
}

/// Nothing of an image, and no more of the cache than a first guess, survives where objects were moved.
#[test]
fn moved_objects_start_everything_again_as_new_lights_do() {
    let gpu = gpu();
    let scene = scene(&lit_room(), 0.0);
    let settings = SurfelSettings { target_error: 0.0, ..SurfelSettings::BALANCED };
    let view = camera([0.6, 0.2, 0.8], [-0.4, -0.3, -0.5]);
    let after = |change: Change| {
        let rig = Rig::new(&gpu, &scene, settings, [24, 24]);
        let mut picture = rig.picture();
        rig.frames(picture.as_mut(), view, 8);
        rig.session.invalidate(change);
        picture.invalidate(change);
        assert_eq!(picture.samples(), 0);
        rig.frames(picture.as_mut(), view, 2);
        rig.values(picture.as_ref())
    };
    let moved = after(Change::Transforms);
    assert_eq!(moved, after(Change::Lights));
    assert_ne!(moved, after(Change::Camera), "a camera keeps the cache's means");
}

/// The first frame, the only one while a camera moves, is as fast as possible; later ones reduce the noise of pixels
/// too.
#[test]
fn a_first_frame_takes_one_sample_of_each_pixel_and_those_after_it_more() {
    let gpu = gpu();
    let scene = scene(&lit_room(), 0.0);
    // Few enough pixels for a test, with the configured rays that a larger image would have.
    let settings = SurfelSettings { target_error: 0.05, rays_per_pixel: 16.0, ..SurfelSettings::BALANCED };
    let rig = Rig::new(&gpu, &scene, settings, [32, 32]);
    let view = FrameView { camera: camera([0.6, 0.2, 0.8], [-0.4, -0.3, -0.5]), size: rig.size, exposure: 1.0 };
    let samples_of_frames = |picture: &mut dyn Technique, frames: u32| -> Vec<u64> {
        let taken = (1..=frames).map(|until_samples| {
            let mut camera_rays = 0;
            while picture.samples() < until_samples {
                let budget = StepBudget { max_paths: 700, until_samples, max_batch: 64 };
                camera_rays += picture.step(&gpu, &rig.buffers, &rig.lights, &view, budget).unwrap().rays[0];
            }
            camera_rays / (32 * 32)
        });
        let taken = taken.collect();
        picture.invalidate(Change::Camera);
        taken
    };
    let mut picture = rig.picture();
    assert_eq!(samples_of_frames(picture.as_mut(), 4), [1, 3, 2, 2]);
    assert_eq!(samples_of_frames(picture.as_mut(), 2), [1, 3], "after a move");
    rig.frames(picture.as_mut(), view.camera, 100);
    picture.invalidate(Change::Camera);
    assert_eq!(samples_of_frames(picture.as_mut(), 4), [1; 4], "once the cache has converged");
    // An update traces many times the rays configured for this number of pixels.
    let rig = Rig::new(&gpu, &scene, SurfelSettings { rays_per_pixel: 0.5, ..settings }, rig.size);
    let mut picture = rig.picture();
    let taken = samples_of_frames(picture.as_mut(), 2);
    assert!(taken.iter().all(|&samples| (4..=16).contains(&samples)), "{taken:?}");
}

/// The first frame on a slow device: few pixels, which surfels of the density of a larger image would leave to noisy
/// paths.
#[test]
fn a_small_first_image_is_lit_by_its_surfels() {
    let gpu = gpu();
    let scene = scene(&lit_room(), 0.0);
    let at = camera([0.6, 0.2, 0.8], [-0.4, -0.3, -0.5]);
    let size = [60, 45];
    let indirect = |rig: &Rig<'_>, frames: u32| {
        let mut picture = rig.picture();
        rig.frames(picture.as_mut(), at, frames);
        let (direct, _) = picture.split().unwrap();
        let direct = rig.read(direct);
        let light = rig.values(picture.as_ref());
        light.iter().zip(direct).map(|(all, direct)| all - direct[0]).collect::<Vec<_>>()
    };
    let [own, eighth] = [1, 8].map(|factor| {
        let rig = Rig::new(&gpu, &scene, SurfelSettings::BALANCED, size);
        let rig = Rig { full_size: size.map(|side| side * factor), ..rig };
        let first = indirect(&rig, 1);
        rmse(&first, &indirect(&rig, 128))
    });
    println!("first image: {own:.4} at full size, {eighth:.4} at an eighth");
    assert!(eighth < 1.5 * own);
}

/// A gesture turns from a still, whose cache is large, to a wall directly in front of the camera.
#[test]
fn newly_visible_surfaces_are_lit_in_the_same_frame() {
    let gpu = gpu();
    let scene = scene(&lit_room(), 0.0);
    let before = camera([0.6, 0.2, 0.8], [-0.4, -0.3, -0.5]);
    let after = camera([0.6, 0.2, 0.8], [0.9, 0.1, 1.0]);
    let (size, full_size) = ([60, 45], [480, 360]);
    let new_rig = |size| Rig { full_size, ..Rig::new(&gpu, &scene, SurfelSettings::BALANCED, size) };
    let indirect = |rig: &Rig<'_>, picture: &dyn Technique| {
        let (direct, _) = picture.split().unwrap();
        let direct = rig.read(direct);
        let light = rig.values(picture);
        light.iter().zip(direct).map(|(all, direct)| all - direct[0]).collect::<Vec<_>>()
    };
    let rig = new_rig(size);
    let mut picture = rig.picture();
    rig.frames(picture.as_mut(), after, 1);
    let first = indirect(&rig, picture.as_ref());
    rig.frames(picture.as_mut(), after, 127);
    let truth = indirect(&rig, picture.as_ref());
    let first = rmse(&first, &truth);

    let mut rig = new_rig(full_size);
    let mut still = rig.picture();
    rig.frames(still.as_mut(), before, 2);
    let [surfels_before, _] = still.occupancy().unwrap();
    drop(still);
    rig.size = size;
    let mut picture = rig.picture();
    rig.frames(picture.as_mut(), after, 1);
    let [surfels, _] = picture.occupancy().unwrap();
    let moved = rmse(&indirect(&rig, picture.as_ref()), &truth);
    println!("{surfels_before} surfels, then {surfels}; {moved:.4} in the gesture, {first:.4} from nothing");
    assert!(moved < 1.5 * first);
}

/// A gesture over surfaces that a still has lit: its small images find the still's surfels and need no coarser ones.
#[test]
fn a_small_image_finds_the_fine_surfels_of_a_large_one() {
    let gpu = gpu();
    let scene = scene(&lit_room(), 0.0);
    let at = camera([0.6, 0.2, 0.8], [-0.4, -0.3, -0.5]);
    let full_size = [192, 144];
    // Small enough that coarser ones are allowed. Without feedback, no surfels are requested at ray hits: all new ones
    // are requested by the images.
    let settings = SurfelSettings { radius_pixels: 1.5, feeds_back: false, ..SurfelSettings::BALANCED };
    let mut rig = Rig::new(&gpu, &scene, settings, full_size);
    let mut large = rig.picture();
    rig.frames(large.as_mut(), at, 16);
    let [before, _] = large.occupancy().unwrap();
    // The gesture's image replaces the still's.
    drop(large);
    rig.size = [48, 36];
    let mut small = rig.picture();
    let rays = rig.frames(small.as_mut(), at, 1);
    let [after, _] = small.occupancy().unwrap();
    let pixels = 48 * 36;
    println!("{before} surfels before, {after} after; {rays} rays for {pixels} pixels");
    assert!(after < before + before / 50, "{before} surfels before, {after} after");
    assert!(rays < pixels / 4, "{rays} rays that surfels should have spared");
}

#[test]
fn a_converged_cache_traces_nothing_and_a_second_camera_on_lit_surfaces_little() {
    let gpu = gpu();
    let scene = scene(&lit_room(), 0.0);
    let settings = SurfelSettings { target_error: 0.02, ..SurfelSettings::BALANCED };
    let rig = Rig::new(&gpu, &scene, settings, [64, 64]);
    let mut first = rig.picture();
    let view = camera([0.6, 0.2, 0.8], [-0.4, -0.3, -0.5]);
    let to_settle = rig.frames(first.as_mut(), view, 200);
    first.invalidate(Change::Camera);
    // Not every frame looks for gaps: the same eight frames again may find one that was missed the first time.
    rig.frames(first.as_mut(), view, 8);
    first.invalidate(Change::Camera);
    let settled = rig.frames(first.as_mut(), view, 8);
    println!("{to_settle} rays to converge, {settled} in 8 frames after that");
    assert_eq!(settled, 0);
    // The second camera sees nearly the same walls from a little to the side.
    let mut second = rig.picture();
    let beside = camera([0.5, 0.2, 0.8], [-0.45, -0.3, -0.5]);
    let more = rig.frames(second.as_mut(), beside, 200);
    println!("{more} rays for the second camera");
    assert!((more as f64) < 0.35 * to_settle as f64, "{more} of {to_settle}");
    second.invalidate(Change::Camera);
    assert_eq!(rig.frames(second.as_mut(), beside, 8), 0);
    // After a lighting change it traces again.
    rig.session.invalidate(Change::Lights);
    second.invalidate(Change::Lights);
    assert!(rig.frames(second.as_mut(), beside, 4) > 0);
}

/// Surfels of a distant camera are six times too coarse for one that has come closer.
#[test]
fn a_camera_that_comes_closer_gets_finer_surfels() {
    let gpu = gpu();
    let scene = scene(&lit_room(), 0.0);
    let settings = SurfelSettings { target_error: 0.0, ..SurfelSettings::BALANCED };
    let near = camera([0.0, -0.75, 0.0], [0.05, -1.0, 0.05]);
    let far = camera([0.6, 0.9, 0.6], [0.0, -1.0, 0.0]);
    let fine_surfels = |cameras: &[(_, u32)]| {
        let rig = Rig::new(&gpu, &scene, settings, [128, 128]);
        for &(view, frames) in cameras {
            let mut picture = rig.picture();
            rig.frames(picture.as_mut(), view, frames);
        }
        let cache = cache_of(&rig.session).unwrap();
        let surfels = cache.lock().export(&gpu).unwrap();
        surfels.iter().filter(|surfel| surfel.record.radius < 0.03).count()
    };
    let [alone, after] = [fine_surfels(&[(near, 6)]), fine_surfels(&[(far, 6), (near, 6)])];
    println!("{alone} fine surfels for a near camera, {after} where a far one had been");
    assert!(after as f64 > 0.7 * alone as f64, "{after} of {alone}");
}

#[test]
fn two_cameras_pay_for_the_rays_once() {
    let gpu = gpu();
    let scene = scene(&lit_room(), 0.0);
    let settings = SurfelSettings { target_error: 0.0, ..SurfelSettings::BALANCED };
    let rig = Rig::new(&gpu, &scene, settings, [64, 64]);
    let view = camera([0.6, 0.2, 0.8], [-0.4, -0.3, -0.5]);
    let mut alone = rig.picture();
    rig.frames(alone.as_mut(), view, 16);
    let one = (17..33).map(|frame| rig.frames(alone.as_mut(), view, frame)).sum::<u64>();
    let mut second = rig.picture();
    rig.frames(second.as_mut(), view, 1);
    let mut both = 0;
    for frame in 0..16 {
        both += rig.frames(alone.as_mut(), view, 33 + frame);
        both += rig.frames(second.as_mut(), view, 2 + frame);
    }
    println!("16 frames: {one} rays for one camera, {both} for two");
    assert!((both as f64) < 1.25 * one as f64, "{both} and {one}");
}
