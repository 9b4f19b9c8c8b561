//! A session: a scene that people look at together, and everything they have changed about it.

use std::borrow::Borrow;
use std::fmt;

use surfelcast_protocol::limits::Limits;
use surfelcast_protocol::settings::LightPatch;

use crate::error::ReviewError;
use crate::lights::LightSet;

/// Hex digits of a scene's id that name its implicit session.
const IMPLICIT_DIGITS: usize = 16;
/// Revision of a session that nobody has edited.
const FIRST_REVISION: u32 = 1;

/// Names a session. It is not the scene's id: two sessions can refer to one scene.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SessionId(String);

impl SessionId {
    /// The session that every scene has without anybody making one: the first 16 hex digits of the scene's `sha256:`
    /// id. `None` where the id is no such digest.
    pub fn implicit_of(scene: &str) -> Option<Self> {
        let digits = scene.strip_prefix("sha256:")?.get(..IMPLICIT_DIGITS)?;
        let is_digit = |byte: u8| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte);
        digits.bytes().all(is_digit).then(|| Self(digits.to_owned()))
    }

    /// The id as it stands in paths and messages.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl Borrow<str> for SessionId {
    fn borrow(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for SessionId {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.0)
    }
}

/// One change of a session.
#[derive(Clone, Debug, PartialEq)]
pub enum Edit {
    /// Changes the lights.
    Lights(LightPatch),
}

/// What the members of a session share.
#[derive(Clone, Debug, PartialEq)]
pub struct Session {
    id: SessionId,
    scene: String,
    lights: LightSet,
    revision: u32,
}

impl Session {
    /// A session of this scene with the scene's own lights.
    pub fn new(id: SessionId, scene: impl Into<String>, lights: LightSet) -> Self {
        Self { id, scene: scene.into(), lights, revision: FIRST_REVISION }
    }

    /// Its id.
    pub fn id(&self) -> &SessionId {
        &self.id
    }

    /// Id of its scene.
    pub fn scene(&self) -> &str {
        &self.scene
    }

    /// Its lights.
    pub fn lights(&self) -> &LightSet {
        &self.lights
    }

    /// Number of the last edit; it rises by 1 with each.
    pub fn revision(&self) -> u32 {
        self.revision
    }

    /// Applies an edit, all of it or nothing, and returns the revision that contains it.
    pub fn apply(&mut self, edit: &Edit, limits: &Limits) -> Result<u32, ReviewError> {
        match edit {
            Edit::Lights(patch) => self.lights.apply(patch, limits.max_lights)?,
        }
        self.revision = self.revision.wrapping_add(1);
        Ok(self.revision)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_implicit_session_is_named_by_the_scene() {
        let scene = format!("sha256:{}", "0123456789abcdef".repeat(4));
        assert_eq!(SessionId::implicit_of(&scene).expect("a digest").as_str(), "0123456789abcdef");
        for bad in
            ["", "sha256:", "sha256:0123", "0123456789abcdef", "sha256:0123456789ABCDEF", "sha256:../../etc/passwd"]
        {
            assert_eq!(SessionId::implicit_of(bad), None, "{bad}");
        }
    }

    #[test]
    fn accepted_edits_are_numbered_and_refused_ones_are_not() {
        let id = SessionId::implicit_of(&format!("sha256:{}", "a".repeat(64))).expect("a digest");
        let mut session = Session::new(id, "sha256:...", LightSet::new([], true));
        let limits = Limits::default();
        let strength = |value| Edit::Lights(LightPatch { emissive_strength: Some(value), ..LightPatch::default() });
        assert_eq!(session.revision(), 1);
        assert_eq!(session.apply(&strength(2.0), &limits), Ok(2));
        assert!(session.apply(&strength(-1.0), &limits).is_err());
        assert_eq!(session.apply(&strength(3.0), &limits), Ok(3));
        assert_eq!((session.revision(), session.lights().emissive_strength()), (3, 3.0));
    }
}
