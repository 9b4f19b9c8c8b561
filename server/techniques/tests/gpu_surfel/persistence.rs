//! A cache outlives the process, and a damaged snapshot does no harm.

use surfelcast_gpu::Gpu;
use surfelcast_scene::Scene;
use surfelcast_techniques::surfel::{ENTRY, SurfelCache, SurfelSettings, cache_of};
use surfelcast_techniques::{SessionState, SnapshotIdentity};

use crate::rig::{Rig, camera, gpu};
use crate::scenes::{Face, Paint, inside_of_box, scene};

const SIZE: [u32; 2] = [48, 48];
const SETTINGS: SurfelSettings = SurfelSettings { target_error: 0.02, ..SurfelSettings::BALANCED };
const IDENTITY: SnapshotIdentity = SnapshotIdentity { scene: [1; 32], lights: [2; 32] };

fn room() -> Vec<Face> {
    let mut faces = inside_of_box([-1.0; 3], [1.0; 3], Paint::matte(0.7));
    faces.push((vec![[-0.3, 0.98, -0.3], [0.3, 0.98, -0.3], [0.3, 0.98, 0.3], [-0.3, 0.98, 0.3]], Paint::lamp(5.0)));
    faces
}

/// A snapshot of a converged cache; irradiance over pi in its image and its number of surfels one frame later.
fn settled(gpu: &Gpu, scene: &Scene) -> (Vec<u8>, Vec<[f32; 4]>, u32) {
    let rig = Rig::new(gpu, scene, SETTINGS, SIZE);
    let mut picture = rig.picture();
    rig.frames(picture.as_mut(), camera([0.6, 0.2, 0.8], [-0.4, -0.3, -0.5]), 200);
    let cache = cache_of(&rig.session).unwrap();
    let bytes = cache.lock().save(gpu, &IDENTITY).unwrap();
    picture.invalidate(surfelcast_techniques::Change::Camera);
    rig.frames(picture.as_mut(), camera([0.6, 0.2, 0.8], [-0.4, -0.3, -0.5]), 1);
    let (_, irradiance) = picture.split().unwrap();
    (bytes, rig.read(irradiance), picture.occupancy().unwrap()[0])
}

#[test]
fn the_first_frame_after_a_restart_is_the_converged_one() {
    let gpu = gpu();
    let scene = scene(&room(), 0.0);
    let (bytes, before, count) = settled(&gpu, &scene);
    let mut rig = Rig::new(&gpu, &scene, SETTINGS, SIZE);
    rig.session = SessionState::default();
    rig.session.of(&ENTRY).restore(IDENTITY, bytes);
    let mut picture = rig.picture();
    let rays = rig.frames(picture.as_mut(), camera([0.6, 0.2, 0.8], [-0.4, -0.3, -0.5]), 1);
    assert_eq!(rays, 0, "the restored cache traced rays");
    let (_, irradiance) = picture.split().unwrap();
    assert!(rig.read(irradiance) == before, "irradiance differs from before the restart");
    assert_eq!(picture.occupancy().unwrap()[0], count, "restored surfels were not found, and new ones spawned");
}

#[test]
fn measured_edges_outlive_the_process() {
    let gpu = gpu();
    let scene = scene(&room(), 0.0);
    let rig = Rig::new(&gpu, &scene, SETTINGS, SIZE);
    let mut picture = rig.picture();
    rig.frames(picture.as_mut(), camera([0.6, 0.2, 0.8], [-0.4, -0.3, -0.5]), 12);
    let cache = cache_of(&rig.session).unwrap();
    let learnt = cache.lock().measured_differences(&gpu).unwrap();
    assert!(learnt.len() > 500, "{} differences", learnt.len());
    let bytes = cache.lock().save(&gpu, &IDENTITY).unwrap();
    let restored = SurfelCache::restore(&gpu, &rig.buffers, SETTINGS, SIZE[0] * SIZE[1], 5, &IDENTITY, &bytes).unwrap();
    assert_eq!(restored.measured_differences(&gpu).unwrap(), learnt);
}

#[test]
fn damaged_and_foreign_snapshots_are_refused_and_a_new_cache_is_made() {
    let gpu = gpu();
    let scene = scene(&room(), 0.0);
    let (bytes, ..) = settled(&gpu, &scene);
    let rig = Rig::new(&gpu, &scene, SETTINGS, SIZE);
    let restore = |bytes: &[u8], identity: &SnapshotIdentity, settings: SurfelSettings| {
        SurfelCache::restore(&gpu, &rig.buffers, settings, SIZE[0] * SIZE[1], 5, identity, bytes)
    };
    let restored = restore(&bytes, &IDENTITY, SETTINGS).unwrap();
    assert!(restored.counts()[0] > 100);
    let refusal = |bytes: &[u8], identity: &SnapshotIdentity, settings: SurfelSettings| {
        restore(bytes, identity, settings).err().map(|error| error.to_string()).unwrap()
    };
    assert!(refusal(&[], &IDENTITY, SETTINGS).contains("damaged"));
    assert!(refusal(&bytes[..bytes.len() / 2], &IDENTITY, SETTINGS).contains("checksum"));
    let other_scene = SnapshotIdentity { scene: [9; 32], ..IDENTITY };
    assert!(refusal(&bytes, &other_scene, SETTINGS).contains("another scene"));
    let other_settings = SurfelSettings { radius_pixels: 9.0, ..SETTINGS };
    assert!(refusal(&bytes, &IDENTITY, other_settings).contains("other settings"));
    // A flipped bit anywhere is detected.
    let step = bytes.len() / 97 + 1;
    for at in (0..bytes.len()).step_by(step) {
        let mut flipped = bytes.clone();
        flipped[at] ^= 1 << (at % 8);
        assert!(restore(&flipped, &IDENTITY, SETTINGS).is_err(), "byte {at}");
    }
    // Other lights than at the time of the snapshot: the surfels stay, and their light is measured again.
    let other_lights = SnapshotIdentity { lights: [7; 32], ..IDENTITY };
    assert_eq!(restore(&bytes, &other_lights, SETTINGS).unwrap().counts(), restored.counts());
    // With an invalid snapshot, a session starts from an empty cache.
    rig.session.of(&ENTRY).restore(IDENTITY, vec![0; 1000]);
    let mut picture = rig.picture();
    assert!(rig.frames(picture.as_mut(), camera([0.6, 0.2, 0.8], [-0.4, -0.3, -0.5]), 2) > 0);
}
