//! Lights of a session: the scene's own, as edited by people.

pub use surfelcast_techniques::LightState as SessionLights;
