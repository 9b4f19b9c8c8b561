//! The answer to `hello`.

use std::sync::atomic::{AtomicU64, Ordering};

use surfelcast_protocol::server::{
    PresetInfo, SessionInfo, SettingInfo, SettingKind, SettingValue, TechniqueInfo, Welcome,
};
use surfelcast_protocol::settings::NamedPose;
use surfelcast_render_api as api;

use crate::camera::pose_of;
use crate::sessions::Live;
use crate::state::ServiceState;

/// Everything that a client must know before its first frame. `token` resumes its view.
pub(crate) fn welcome(state: &ServiceState, live: &Live, token: &str) -> Welcome {
    static CONNECTIONS: AtomicU64 = AtomicU64::new(1);
    let status = state.renderer_status();
    let config = state.config();
    let scene = &live.scene;
    let named = |camera: &surfelcast_renderer::scene::NamedCamera| NamedPose {
        name: camera.name.clone(),
        pose: pose_of(&camera.camera),
        exposure: scene.exposure_for(&camera.name),
    };
    Welcome {
        v: surfelcast_protocol::VERSION,
        conn: format!("c{}", CONNECTIONS.fetch_add(1, Ordering::Relaxed)),
        session: SessionInfo {
            id: live.id().to_string(),
            scene: live.record.id.clone(),
            scene_name: live.record.name.clone(),
            scene_rev: live.revision(),
            epoch: status.epoch,
            triangle_count: live.record.triangle_count,
        },
        limits: config.limits,
        techniques: techniques(&status.catalogue),
        outputs: crate::live::outputs::offered(&status.catalogue),
        cameras: scene.cameras.iter().map(named).collect(),
        center: (scene.origin + scene.bounds.center().as_dvec3()).to_array(),
        radius: f64::from(scene.bounds.radius()),
        warnings: live.record.warnings.clone(),
        server_ms: state.server_ms(),
        resume_token: token.to_owned(),
        grace_ms: config.timeouts.resume.as_millis() as u32,
        server: config.server.clone(),
        device: status.device.name.clone(),
    }
}

/// Every technique under each of its ids, with what can be set under that id.
fn techniques(catalogue: &api::Catalogue) -> Vec<TechniqueInfo> {
    let info = |(id, label, summary): (&str, &str, &str)| {
        let chosen = catalogue.choose(id);
        let settings = chosen.iter().flat_map(|chosen| {
            chosen.technique.settings.iter().map(|setting| setting_info(setting, chosen.settings.get(setting)))
        });
        let presets = chosen.iter().flat_map(|chosen| chosen.technique.presets);
        TechniqueInfo {
            id: id.into(),
            label: label.into(),
            summary: summary.into(),
            settings: settings.collect(),
            presets: presets
                .map(|preset| PresetInfo {
                    id: preset.id.into(),
                    values: preset
                        .values
                        .iter()
                        .map(|(id, value)| ((*id).into(), in_protocol(value.clone())))
                        .collect(),
                })
                .collect(),
        }
    };
    catalogue.technique_ids().map(info).collect()
}

/// A setting whose default is the value that the technique's id stands for.
fn setting_info(setting: &api::Setting, default: api::SettingValue) -> SettingInfo {
    let info = SettingInfo {
        id: setting.id.into(),
        label: setting.label.into(),
        help: setting.help.into(),
        unit: setting.unit.into(),
        kind: SettingKind::Switch,
        default: in_protocol(default),
        range: None,
        is_integer: false,
        names: Vec::new(),
    };
    match setting.kind {
        api::SettingKind::Number { range, is_integer, .. } => {
            SettingInfo { kind: SettingKind::Number, range: Some(range), is_integer, ..info }
        }
        api::SettingKind::Switch { .. } => info,
        api::SettingKind::Choice { names, .. } => {
            let names = names.iter().map(|&name| name.to_owned()).collect();
            SettingInfo { kind: SettingKind::Choice, names, ..info }
        }
    }
}

fn in_protocol(value: api::SettingValue) -> SettingValue {
    match value {
        api::SettingValue::Switch(is_on) => SettingValue::Switch(is_on),
        api::SettingValue::Number(number) => SettingValue::Number(number),
        api::SettingValue::Choice(name) => SettingValue::Choice(name.into_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_catalogue::catalogue;

    #[test]
    fn every_id_is_offered_with_its_settings() {
        let offered = serde_json::to_value(techniques(&catalogue())).expect("encodes");
        let ids: Vec<&str> = offered.as_array().expect("a list").iter().filter_map(|t| t["id"].as_str()).collect();
        assert_eq!(ids, ["path", "other", "other_soft"]);
        assert_eq!(offered[0].as_object().expect("an object").len(), 3, "nothing to set, nothing sent");
        let other = &offered[1];
        assert_eq!(other["settings"][0]["range"], serde_json::json!([1.5, 32.0]));
        assert_eq!((&other["settings"][0]["kind"], &other["settings"][0]["default"]), (&"number".into(), &5.0.into()));
        assert_eq!(other["settings"][2]["names"], serde_json::json!(["none", "poisson"]));
        assert_eq!(other["settings"][3]["default"], true);
        assert_eq!(other["presets"][2], serde_json::json!({"id": "high", "values": {"radius": 3.0, "rays": 1.0}}));
        assert_eq!(offered[2]["settings"][0]["default"], 16.0, "what the alias stands for");
    }
}
