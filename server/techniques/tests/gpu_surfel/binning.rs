//! The order in which rays are traced changes nothing but the time.

use surfelcast_techniques::Change;
use surfelcast_techniques::surfel::{ExportedSurfel, SurfelSettings, cache_of};

use crate::rig::{Rig, camera, gpu};
use crate::scenes::{Paint, inside_of_box, scene};

#[test]
fn binned_rays_bring_back_the_same_bits() {
    let gpu = gpu();
    let mut faces = inside_of_box([-1.0; 3], [1.0; 3], Paint::matte(0.7));
    faces.push((vec![[-0.3, 0.98, -0.3], [0.3, 0.98, -0.3], [0.3, 0.98, 0.3], [-0.3, 0.98, 0.3]], Paint::lamp(5.0)));
    let scene = scene(&faces, 0.0);
    for guided_share in [0.0, 0.5] {
        let walk = |bins_rays| {
            let settings = SurfelSettings { bins_rays, guided_share, target_error: 0.0, ..SurfelSettings::BALANCED };
            let rig = Rig::new(&gpu, &scene, settings, [64, 48]);
            let mut picture = rig.picture();
            for step in 0..6 {
                picture.invalidate(Change::Camera);
                let view = camera([0.6, 0.2, 0.8 - 0.1 * f64::from(step)], [-0.4, -0.3, -0.5]);
                // In pieces, so that a dispatch traces a part of the sequence.
                rig.frames_in_pieces(picture.as_mut(), view, 3, 1500);
            }
            let cache = cache_of(&rig.session).unwrap();
            let surfels: Vec<ExportedSurfel> = cache.lock().export(&gpu).unwrap();
            (rig.read(picture.picture()), surfels)
        };
        let (picture, surfels) = walk(false);
        let (binned_picture, binned_surfels) = walk(true);
        assert!(surfels.len() > 100 && surfels.iter().any(|surfel| surfel.light.indirect[0] > 0.0));
        assert!(picture == binned_picture, "guiding {guided_share}: images differ");
        assert!(surfels == binned_surfels, "guiding {guided_share}: caches differ");
    }
}
