//! Drawn surfels give the same light as gathered ones.

use surfelcast_gpu::Buffer;
use surfelcast_scene::{Camera, LoadOptions, Scene, ViewFile, demo, load_bytes};
use surfelcast_techniques::FrameView;
use surfelcast_techniques::surfel::{Apply, SurfelSettings, cache_of};
use surfelcast_techniques::technique::Technique;

use crate::rig::{Rig, gpu, mean};

const SIZE: [u32; 2] = [96, 72];
/// Trust below which a pixel would trace a path instead.
const TRUSTED: f32 = 0.06;

fn demo_scene(name: &str) -> (Scene, Camera) {
    let scenes = demo::scenes();
    let demo = scenes.iter().find(|demo| demo.name == name).unwrap();
    let view = ViewFile::parse(demo.view.as_bytes()).unwrap();
    let scene = load_bytes(&demo.glb, demo.name, &LoadOptions { view: Some(view), ..LoadOptions::default() }).unwrap();
    let camera = scene.cameras[0].camera;
    (scene, camera)
}

fn applied(rig: &Rig<'_>, picture: &dyn Technique, camera: Camera, apply: Apply) -> Vec<[f32; 4]> {
    let view = FrameView { camera, size: rig.size, exposure: 1.0 };
    let cache = cache_of(&rig.session).unwrap();
    let mut cache = cache.lock();
    let (buffer, passes): (Buffer, _) =
        cache.apply(rig.gpu, &rig.buffers, &rig.lights, &view, picture.features(), 7, apply).unwrap();
    assert_eq!(passes.len(), if apply == Apply::Gather { 2 } else { 3 }, "{passes:?}");
    let pixels = (rig.size[0] * rig.size[1]) as usize;
    rig.read(&buffer)[..pixels].to_vec()
}

/// Of the pixels that a gather trusts: the share that `other` trusts too, and among those the share whose irradiance
/// differs by more than 0.1 %, and the mean of the relative differences.
fn compare(gathered: &[[f32; 4]], other: &[[f32; 4]]) -> [f64; 3] {
    let trusted: Vec<_> = gathered.iter().zip(other).filter(|(a, _)| a[3] > TRUSTED).collect();
    assert!(trusted.len() > gathered.len() / 4, "{} trusted pixels", trusted.len());
    let both: Vec<f32> = trusted
        .iter()
        .filter(|(_, b)| b[3] > TRUSTED)
        .map(|(a, b)| {
            let scale = a[0].max(a[1]).max(a[2]).max(1e-6);
            (0..3).map(|channel| (a[channel] - b[channel]).abs() / scale).fold(0.0, f32::max)
        })
        .collect();
    let off = both.iter().filter(|&&difference| difference > 1e-3).count();
    [both.len() as f64 / trusted.len() as f64, off as f64 / both.len() as f64, mean(&both)]
}

/// Boxes and quads against a gather from one camera.
fn check(rig: &Rig<'_>, picture: &dyn Technique, camera: Camera, name: &str, boxes: [f64; 2]) {
    let gathered = applied(rig, picture, camera, Apply::Gather);
    // Quads miss what lies off their plane, at the borders of surfaces at grazing angles.
    // Error of sums in 16-bit floats.
    let [off_by_boxes, by_boxes] = if rig.gpu.draws_full_floats() { boxes } else { [0.1, 6e-3] };
    for (apply, [least_found, most_off, most_difference]) in
        [(Apply::Boxes, [0.999, off_by_boxes, by_boxes]), (Apply::Quads, [0.98, 0.1, 1e-2])]
    {
        let [found, off, difference] = compare(&gathered, &applied(rig, picture, camera, apply));
        println!(
            "{name}, {apply:?}: {found:.4} found, {off:.4} off by more than 0.1 %, mean difference {difference:.2e}"
        );
        assert!(found > least_found && off <= most_off && difference <= most_difference);
    }
}

#[test]
fn boxes_give_the_light_that_a_gather_gives_and_quads_nearly() {
    let gpu = gpu();
    let (scene, home) = demo_scene("cornell_box");
    let rig = Rig::new(&gpu, &scene, SurfelSettings::BALANCED, SIZE);
    let mut picture = rig.picture();
    rig.frames(picture.as_mut(), home, 8);
    // Boxes may differ only by the order of sums.
    check(&rig, picture.as_ref(), home, "cornell box", [0.0, 1e-6]);
    // Along a wall, with the camera inside the boxes of the surfels next to it.
    let towards = (home.target - home.position).normalize_or(-home.up);
    let hit = surfelcast_scene::trace::closest_hit(
        &scene.geometry,
        (home.position - scene.origin).as_vec3(),
        towards.as_vec3(),
        0.0,
        f32::MAX,
    );
    let at_wall = home.position + towards * (f64::from(hit.unwrap().t) - 0.02);
    let near = Camera { position: at_wall, target: at_wall + towards.cross(home.up), ..home };
    check(&rig, picture.as_ref(), near, "along a wall", [0.0, 1e-6]);

    let (scene, home) = demo_scene("interior");
    let rig = Rig::new(&gpu, &scene, SurfelSettings::BALANCED, SIZE);
    let mut picture = rig.picture();
    rig.frames(picture.as_mut(), home, 8);
    // Behind the still life, slots of the grid overflow, of which a gather reads a random subset.
    check(&rig, picture.as_ref(), home, "interior", [0.02, 3e-3]);
}

#[test]
fn images_by_boxes_share_the_cache_match_and_repeat() {
    let gpu = gpu();
    let (scene, view) = demo_scene("cornell_box");
    let run = |apply: Apply, paths: u64| {
        let mut rig = Rig::new(&gpu, &scene, SurfelSettings::BALANCED, [64, 48]);
        let mut first = rig.picture();
        let cache_of_first = cache_of(&rig.session).unwrap();
        rig.frames(first.as_mut(), view, 12);
        rig.settings = SurfelSettings { apply, ..SurfelSettings::BALANCED };
        let mut second = rig.picture();
        assert!(
            std::sync::Arc::ptr_eq(&cache_of_first, &cache_of(&rig.session).unwrap()),
            "both ways of applying share one cache"
        );
        rig.frames_in_pieces(second.as_mut(), view, 4, paths);
        rig.read(second.picture())
    };
    let gathered = run(Apply::Gather, u64::MAX);
    let drawn = run(Apply::Boxes, u64::MAX);
    let red = |picture: &[[f32; 4]]| picture.iter().map(|pixel| pixel[0]).collect::<Vec<_>>();
    let difference: Vec<f32> = red(&gathered).iter().zip(red(&drawn)).map(|(a, b)| (a - b).abs()).collect();
    let [share, mean_value] = [mean(&difference), mean(&red(&gathered))];
    println!("mean difference {share:.2e} of {mean_value:.3}");
    let most = if gpu.draws_full_floats() { 1e-5 } else { 1e-3 };
    assert!(share < most * mean_value);
    assert!(gathered != run(Apply::Quads, u64::MAX), "nothing was drawn");
    assert!(drawn == run(Apply::Boxes, 1000), "pieces change the image");
}
