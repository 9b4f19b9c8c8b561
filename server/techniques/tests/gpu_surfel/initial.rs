//! The first surfels are where uniform directions over the sphere hit surfaces, in the order of the directions.

use glam::Vec3;
use surfelcast_techniques::surfel::{Initial, SurfelOutput, SurfelSettings, cache_of};

use crate::rig::{Rig, camera, gpu};
use crate::scenes::{Paint, inside_of_box, scene};

const SIZE: [u32; 2] = [96, 72];
const EYE: [f64; 3] = [0.1, -0.2, 0.3];

/// Directions from the camera to a cache's surfels after one frame, in the order of their ids, and the share of pixels
/// that they cover.
fn directions(initial: Initial) -> (Vec<Vec3>, f64) {
    let gpu = gpu();
    let scene = scene(&inside_of_box([-1.0; 3], [1.0; 3], Paint { albedo: 0.5, emission: 0.5, is_unlit: false }), 0.0);
    let settings = SurfelSettings { initial, radius_pixels: 2.0, ..SurfelSettings::BALANCED };
    let rig = Rig::new(&gpu, &scene, settings, SIZE);
    let mut picture = rig.picture();
    let camera = camera(EYE, [0.9, 0.2, -0.6]);
    rig.frames(picture.as_mut(), camera, 1);
    let cache = cache_of(&rig.session).unwrap();
    let surfels = cache.lock().export(&gpu).unwrap();
    let eye = (camera.position - scene.origin).as_vec3();
    let view = surfelcast_techniques::FrameView { camera, size: SIZE, exposure: 1.0 };
    let output = SurfelOutput::Coverage;
    let look = cache.lock().look(&gpu, &rig.buffers, &rig.lights, &view, picture.features(), output, false);
    let pixels = rig.read(&look.unwrap().0);
    let covered = pixels.iter().filter(|pixel| pixel[0] >= settings.coverage).count() as f64 / pixels.len() as f64;
    assert!(
        surfels.iter().zip(1..).all(|(surfel, serial)| surfel.record.serial == serial),
        "ids are not in the order of spawning"
    );
    (surfels.iter().map(|surfel| (Vec3::from(surfel.record.position) - eye).normalize_or(Vec3::Z)).collect(), covered)
}

#[test]
fn first_surfels_are_around_the_camera_in_the_order_of_their_directions() {
    let (gaps, covered) = directions(Initial::Gaps);
    let (fibonacci, fibonacci_covered) = directions(Initial::Fibonacci);
    let (hilbert, hilbert_covered) = directions(Initial::Hilbert);
    println!("{} {} {} surfels", gaps.len(), fibonacci.len(), hilbert.len());
    println!("share covered {covered:.3} {fibonacci_covered:.3} {hilbert_covered:.3}");
    // 36 times the coverage over the squared tangent of a radius.
    let tangent = 2.0 * 2.0 * 0.6f32.tan() / SIZE[1] as f32;
    let seeded = (36.0 * 0.3 / (tangent * tangent)) as usize;
    // Where consecutive ones are too close to each other, in corners, one of them is rejected.
    let begin = |all: &[Vec3]| all[..seeded * 9 / 10].to_vec();
    let (gaps, fibonacci, hilbert) = (gaps, begin(&fibonacci), begin(&hilbert));
    assert!(fibonacci.windows(2).all(|pair| pair[0].z > pair[1].z), "heights fall along a Fibonacci set");
    let step = |all: &[Vec3]| {
        let mut angles: Vec<f32> = all.windows(2).map(|pair| pair[0].angle_between(pair[1])).collect();
        angles.sort_by(f32::total_cmp);
        angles[angles.len() / 2]
    };
    println!("median angle from one to the next: {:.3} {:.3} {:.3}", step(&gaps), step(&fibonacci), step(&hilbert));
    // The angle that a surfel spans, seen from the camera.
    let spacing = (4.0 * std::f32::consts::PI / seeded as f32).sqrt();
    assert!(step(&hilbert) < 1.5 * spacing && step(&fibonacci) > 10.0 * spacing);
    // As many behind the camera as in front of it.
    for all in [&fibonacci, &hilbert] {
        let mean = all.iter().sum::<Vec3>() / all.len() as f32;
        assert!(mean.length() < 0.25, "{mean}");
    }
    // Gaps are filled afterwards.
    assert!(fibonacci_covered > covered - 0.02 && hilbert_covered > covered - 0.02);
}
