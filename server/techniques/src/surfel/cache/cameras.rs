//! The cameras that use a cache: they decide on the radii of surfels and on what is pinned.

use glam::DVec3;
use surfelcast_passes::frame::FrameView;

/// Cameras that decide on radii at most; further views are served all the same.
const MAX_CAMERAS: usize = 8;

/// A camera that uses the cache.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CacheCamera {
    /// Position in scene space.
    pub(crate) position: [f32; 3],
    /// Size of a pixel at distance 1.
    pub(crate) pixel_size: f32,
}

impl CacheCamera {
    /// The camera of a view whose full image has `full_size` pixels, in a scene whose space begins at `origin`.
    pub(crate) fn of_view(view: &FrameView, origin: DVec3, full_size: [u32; 2]) -> Self {
        let pixel_size = 2.0 * (view.camera.vfov * 0.5).tan() / f64::from(full_size[1].max(1));
        Self { position: (view.camera.position - origin).as_vec3().to_array(), pixel_size: pixel_size as f32 }
    }
}

/// All cameras of a cache, by the number that each got when it was added.
#[derive(Debug, Default)]
pub(super) struct Cameras {
    placed: Vec<(u64, CacheCamera)>,
    last_number: u64,
    /// Cameras that pin what they see.
    pinning: Vec<u64>,
    /// The last pinning camera is gone: the pins are to be cleared.
    pub(super) has_stale_pins: bool,
}

impl Cameras {
    pub(super) fn add(&mut self, pins: bool) -> u64 {
        self.last_number += 1;
        if pins {
            self.pinning.push(self.last_number);
        }
        self.last_number
    }

    pub(super) fn place(&mut self, number: u64, camera: CacheCamera) {
        match self.placed.iter_mut().find(|(known, _)| *known == number) {
            Some((_, known)) => *known = camera,
            None => self.placed.push((number, camera)),
        }
    }

    pub(super) fn remove(&mut self, number: u64) {
        self.placed.retain(|(known, _)| *known != number);
        if self.pinning.contains(&number) {
            self.pinning.retain(|known| *known != number);
            self.has_stale_pins |= self.pinning.is_empty();
        }
    }

    /// The camera that was placed first.
    pub(super) fn first(&self) -> Option<CacheCamera> {
        self.placed.first().map(|(_, camera)| *camera)
    }

    /// The cameras as uniforms, and their number. With more than [`MAX_CAMERAS`] the newest decide.
    pub(super) fn slots(&self) -> ([[f32; 4]; MAX_CAMERAS], u32) {
        let mut slots = [[0.0; 4]; MAX_CAMERAS];
        let used = &self.placed[self.placed.len().saturating_sub(MAX_CAMERAS)..];
        for (slot, (_, camera)) in slots.iter_mut().zip(used) {
            let [x, y, z] = camera.position;
            *slot = [x, y, z, camera.pixel_size];
        }
        (slots, used.len() as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(x: f32) -> CacheCamera {
        CacheCamera { position: [x, 0.0, 0.0], pixel_size: 1.0 }
    }

    #[test]
    fn the_newest_cameras_decide_where_there_are_too_many() {
        let mut cameras = Cameras::default();
        for x in 0..10 {
            let number = cameras.add(false);
            cameras.place(number, camera(x as f32));
        }
        let (slots, count) = cameras.slots();
        assert_eq!((count, slots[0][0], slots[7][0]), (8, 2.0, 9.0));
        assert_eq!(cameras.first(), Some(camera(0.0)));
    }

    #[test]
    fn pins_are_stale_when_the_last_pinning_camera_is_gone() {
        let mut cameras = Cameras::default();
        let [first, other, second] = [cameras.add(true), cameras.add(false), cameras.add(true)];
        cameras.remove(first);
        cameras.remove(other);
        assert!(!cameras.has_stale_pins);
        cameras.remove(second);
        assert!(cameras.has_stale_pins);
    }
}
