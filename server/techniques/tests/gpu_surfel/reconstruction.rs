//! Promises of the solve over the surfels.

use crate::rig::{Rig, camera, gpu, mean, tone_mapped_rmse};
use crate::scenes::{Face, Paint, inside_of_box, scene};
use surfelcast_techniques::surfel::{Reconstruction, SurfelSettings, cache_of};

pub(crate) const SIZE: [u32; 2] = [64, 48];

fn luminance(c: [f32; 3]) -> f64 {
    f64::from(c[0]) * 0.2126 + f64::from(c[1]) * 0.7152 + f64::from(c[2]) * 0.0722
}

/// A room with a lamp under the ceiling and a board that casts a shadow.
pub(crate) fn room() -> Vec<Face> {
    let mut faces = inside_of_box([-1.0; 3], [1.0; 3], Paint::matte(0.6));
    let lamp = vec![[-0.3, 0.95, -0.3], [0.3, 0.95, -0.3], [0.3, 0.95, 0.3], [-0.3, 0.95, 0.3]];
    let board = vec![[-0.6, -1.0, -0.2], [0.2, -1.0, -0.2], [0.2, 0.1, -0.2], [-0.6, 0.1, -0.2]];
    faces.push((lamp, Paint::lamp(8.0)));
    faces.push((board, Paint::matte(0.6)));
    faces
}

pub(crate) fn settings(reconstruction: Reconstruction) -> SurfelSettings {
    SurfelSettings { reconstruction, shares: false, rays_per_pixel: 2.0, target_error: 0.0, ..SurfelSettings::BALANCED }
}

fn pictures(reconstruction: Reconstruction, frames: u32) -> Vec<f32> {
    let gpu = gpu();
    let scene = scene(&room(), 0.0);
    let rig = Rig::new(&gpu, &scene, settings(reconstruction), SIZE);
    let mut picture = rig.picture();
    rig.frames(picture.as_mut(), camera([0.0, 0.0, 0.95], [0.0, -0.2, 0.0]), frames);
    let (_, irradiance) = picture.split().unwrap();
    rig.read(irradiance).iter().map(|pixel| pixel[0]).collect()
}

/// Reconnected rays measure the differences of converged values, across corners, contacts and shadow edges alike.
#[test]
fn reconnected_rays_measure_the_differences_of_converged_values() {
    let gpu = gpu();
    let scene = scene(&room(), 0.0);
    let many = SurfelSettings { rays_per_pixel: 8.0, ..settings(Reconstruction::Poisson) };
    let rig = Rig::new(&gpu, &scene, many, SIZE);
    let mut picture = rig.picture();
    rig.frames(picture.as_mut(), camera([0.0, 0.0, 0.95], [0.0, -0.2, 0.0]), 128);
    let cache = cache_of(&rig.session).unwrap();
    let cache = cache.lock();
    let surfels = cache.export(&gpu).unwrap();
    let value = |end: u32| {
        let light = surfels[end as usize].light;
        (luminance(light.direct) + luminance(light.indirect), f64::from(light.variance / light.ray_count.max(1.0)))
    };
    let mut scores = Vec::new();
    let mut sizes = Vec::new();
    for edge in cache.measured_differences(&gpu).unwrap() {
        let enough = edge.counts.iter().all(|&count| count >= 8.0);
        let young = edge.ends.iter().any(|&end| surfels[end as usize].light.ray_count < 800.0);
        if !enough || young {
            continue;
        }
        let [(a, va), (b, vb)] = edge.ends.map(value);
        let error = luminance(edge.difference) - (b - a);
        scores.push(error / (f64::from(edge.variance) + va + vb).sqrt().max(1e-9));
        sizes.push((b - a).abs());
    }
    let rms = (scores.iter().map(|z| z * z).sum::<f64>() / scores.len() as f64).sqrt();
    let average = scores.iter().sum::<f64>() / scores.len() as f64;
    let far = scores.iter().filter(|z| z.abs() > 3.0).count() as f64 / scores.len() as f64;
    let typical = sizes.iter().sum::<f64>() / sizes.len() as f64;
    println!(
        "{} edges: z {average:.3}, rms {rms:.3}, beyond three {:.2} %, mean difference {typical:.4}",
        scores.len(),
        100.0 * far
    );
    assert!(scores.len() > 1000, "{}", scores.len());
    assert!(average.abs() < 0.1 && rms < 1.2 && far < 0.01, "{average} {rms} {far}");
}

/// The solve lowers the error of the first frames by much, and still lowers it when the values alone are good.
#[test]
fn reconstruction_lowers_the_error_early_and_never_raises_it() {
    let truth = pictures(Reconstruction::None, 256);
    for (frames, most) in [(2, 0.7), (8, 0.8), (32, 1.02)] {
        let [none, regression, poisson] = [Reconstruction::None, Reconstruction::Regression, Reconstruction::Poisson]
            .map(|reconstruction| tone_mapped_rmse(&pictures(reconstruction, frames), &truth));
        println!("{frames} frames: none {none:.5}, regression {regression:.5}, poisson {poisson:.5}");
        assert!(poisson <= most * none, "{frames} frames: {poisson} {none}");
        assert!(regression <= 1.02 * none, "{frames} frames: {regression} {none}");
    }
}

/// The solve weights values and differences without gaining or losing light.
#[test]
fn reconstruction_keeps_the_energy() {
    let truth = mean(&pictures(Reconstruction::None, 96));
    let solved = mean(&pictures(Reconstruction::Poisson, 16));
    println!("energy {:.4}", solved / truth);
    assert!((solved / truth - 1.0).abs() < 0.02, "{solved} {truth}");
}

/// Where differences add nothing to the regression, hardly any rays are spent on them.
#[test]
fn differences_that_add_nothing_are_hardly_measured() {
    let gpu = gpu();
    let scene = scene(&room(), 0.0);
    let at = camera([0.0, 0.0, 0.95], [0.0, -0.2, 0.0]);
    let [without, with] = [Reconstruction::Regression, Reconstruction::Poisson].map(|reconstruction| {
        let rig = Rig::new(&gpu, &scene, settings(reconstruction), SIZE);
        let mut picture = rig.picture();
        // Surfels of few rays measure them, to find out whether they pay.
        rig.frames(picture.as_mut(), at, 8);
        rig.rays(picture.as_mut(), at, 32, u64::MAX)[2]
    });
    println!("shadow rays: {without} without, {with} with");
    assert!((with as f64) < 1.08 * without as f64, "{without} {with}");
}
