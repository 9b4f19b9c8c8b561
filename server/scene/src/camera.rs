//! Pinhole cameras in world space.

use glam::DVec3;

/// A pinhole camera: no lens, square pixels, box-filtered pixels, first row on top.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Eye, world space, metres.
    pub position: DVec3,
    /// A point on the optical axis, world space; differs from `position`.
    pub target: DVec3,
    /// Roughly up, world space; not parallel to the axis.
    pub up: DVec3,
    /// Vertical field of view, radians, in (0, pi).
    pub vfov: f64,
}

impl Camera {
    /// Whether position, target, up and field of view are finite and span a frame.
    pub fn is_valid(&self) -> bool {
        let axis = self.target - self.position;
        let finite = self.position.is_finite() && self.target.is_finite() && self.up.is_finite();
        finite
            && self.vfov > 0.0
            && self.vfov < std::f64::consts::PI
            && axis.length_squared() > 0.0
            && axis.cross(self.up).length_squared() > 1e-18 * axis.length_squared() * self.up.length_squared()
    }

    /// Right, up and forward unit vectors of the view, world space. Forward points from the eye to the target.
    pub fn frame(&self) -> (DVec3, DVec3, DVec3) {
        let forward = (self.target - self.position).normalize_or(DVec3::NEG_Z);
        let right = forward.cross(self.up).normalize_or(forward.any_orthonormal_vector());
        (right, right.cross(forward), forward)
    }
}

/// A camera with the name people choose it by, and the resolution its author meant.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedCamera {
    /// Name, unique within the scene.
    pub name: String,
    /// The camera.
    pub camera: Camera,
    /// Width and height in pixels, where the view file states them.
    pub resolution: Option<[u32; 2]>,
}
