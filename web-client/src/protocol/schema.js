/**
 * Generated from protocol/src by protocol/tests/page_types.rs. Do not edit: change the Rust types, then run
 * `SURFELCAST_UPDATE=1 cargo nextest run --release -p surfelcast-protocol --test page_types`.
 */

/** @type {Record<string, import('./check.js').Schema>} */
export const definitions = {
  "Column": {"properties":{"id":{"type":"string"},"label":{"type":"string"},"unit":{"type":"string"}},"required":["id","label"],"type":"object"},
  "Disc": {"properties":{"normal":{"items":{"type":"number"},"maxItems":3,"minItems":3,"type":"array"},"position":{"items":{"type":"number"},"maxItems":3,"minItems":3,"type":"array"},"radius":{"type":"number"}},"required":["position","normal","radius"],"type":"object"},
  "ErrorInfo": {"properties":{"rmse":{"type":"number"},"std_error":{"type":"number"}},"required":["rmse","std_error"],"type":"object"},
  "Field": {"properties":{"id":{"type":"string"},"label":{"type":"string"},"unit":{"type":"string"},"value":{"$ref":"#/$defs/FieldValue"}},"required":["id","label","value"],"type":"object"},
  "FieldValue": {"anyOf":[{"type":"integer"},{"type":"number"},{"items":{"type":"number"},"maxItems":3,"minItems":3,"type":"array"}]},
  "Inspection": {"properties":{"columns":{"items":{"$ref":"#/$defs/Column"},"type":"array"},"headline":{"type":"string"},"normal":{"items":{"type":"number"},"maxItems":3,"minItems":3,"type":"array"},"position":{"items":{"type":"number"},"maxItems":3,"minItems":3,"type":"array"},"rows":{"items":{"$ref":"#/$defs/Row"},"type":"array"},"summary":{"items":{"$ref":"#/$defs/Field"},"type":"array"}},"required":["position","normal","headline","summary","columns","rows"],"type":"object"},
  "Light": {"properties":{"color":{"items":{"type":"number"},"maxItems":3,"minItems":3,"type":"array"},"cone_deg":{"items":{"type":"number"},"maxItems":2,"minItems":2,"type":["array","null"]},"direction":{"items":{"type":"number"},"maxItems":3,"minItems":3,"type":"array"},"enabled":{"default":true,"type":"boolean"},"id":{"type":"integer"},"intensity":{"type":"number"},"kind":{"$ref":"#/$defs/LightKind"},"name":{"type":"string"},"position":{"items":{"type":"number"},"maxItems":3,"minItems":3,"type":"array"}},"required":["id","name","kind","position","direction","color","intensity"],"type":"object"},
  "LightKind": {"type":"string"},
  "Limits": {"properties":{"control_bytes":{"type":"integer"},"hello_bytes":{"type":"integer"},"hello_timeout_ms":{"type":"integer"},"inputs_per_sec":{"type":"integer"},"max_lights":{"type":"integer"},"max_pixels":{"type":"integer"},"max_side":{"type":"integer"},"views_per_session":{"type":"integer"}},"required":["control_bytes","hello_bytes","hello_timeout_ms","inputs_per_sec","max_side","max_pixels","views_per_session","max_lights"],"type":"object"},
  "NamedPose": {"properties":{"exposure":{"type":"number"},"name":{"type":"string"},"pose":{"$ref":"#/$defs/Pose"}},"required":["name","pose","exposure"],"type":"object"},
  "NoticeKind": {"type":"string"},
  "OutputInfo": {"properties":{"help":{"type":"string"},"id":{"type":"string"},"label":{"type":"string"},"technique":{"type":["string","null"]}},"required":["id","label"],"type":"object"},
  "PassInfo": {"properties":{"ms":{"type":"number"},"name":{"type":"string"}},"required":["name","ms"],"type":"object"},
  "Pose": {"properties":{"eye":{"items":{"type":"number"},"maxItems":3,"minItems":3,"type":"array"},"target":{"items":{"type":"number"},"maxItems":3,"minItems":3,"type":"array"},"up":{"items":{"type":"number"},"maxItems":3,"minItems":3,"type":"array"},"vfov_deg":{"type":"number"}},"required":["eye","target","up","vfov_deg"],"type":"object"},
  "PresetInfo": {"properties":{"id":{"type":"string"},"values":{"additionalProperties":{"$ref":"#/$defs/SettingValue"},"type":"object"}},"required":["id","values"],"type":"object"},
  "Row": {"properties":{"disc":{"anyOf":[{"$ref":"#/$defs/Disc"},{"type":"null"}]},"values":{"items":{"$ref":"#/$defs/FieldValue"},"type":"array"}},"required":["values"],"type":"object"},
  "SessionInfo": {"properties":{"epoch":{"type":"integer"},"id":{"type":"string"},"scene":{"type":"string"},"scene_name":{"type":"string"},"scene_rev":{"type":"integer"},"triangle_count":{"type":"integer"}},"required":["id","scene","scene_name","scene_rev","epoch","triangle_count"],"type":"object"},
  "SettingInfo": {"properties":{"default":{"$ref":"#/$defs/SettingValue"},"help":{"type":"string"},"id":{"type":"string"},"is_integer":{"type":"boolean"},"kind":{"$ref":"#/$defs/SettingKind"},"label":{"type":"string"},"names":{"items":{"type":"string"},"type":"array"},"range":{"items":{"type":"number"},"maxItems":2,"minItems":2,"type":["array","null"]},"unit":{"type":"string"}},"required":["id","label","help","kind","default"],"type":"object"},
  "SettingKind": {"type":"string"},
  "SettingValue": {"anyOf":[{"type":"boolean"},{"type":"number"},{"type":"string"}]},
  "SkippedInfo": {"properties":{"name":{"type":"string"},"reason":{"type":"string"}},"required":["name","reason"],"type":"object"},
  "Stats": {"properties":{"converged":{"type":"boolean"},"error":{"anyOf":[{"$ref":"#/$defs/ErrorInfo"},{"type":"null"}]},"fps":{"type":"number"},"passes":{"items":{"$ref":"#/$defs/PassInfo"},"type":"array"},"quality":{"type":"integer"},"reason":{"type":"string"},"rtt_ms":{"type":"number"},"samples":{"type":"integer"},"scale":{"type":"number"},"skipped":{"items":{"$ref":"#/$defs/SkippedInfo"},"type":"array"},"view":{"type":"integer"},"window":{"type":"integer"}},"required":["view","quality","scale","fps","window","rtt_ms","reason","samples","converged","passes","skipped"],"type":"object"},
  "TechniqueInfo": {"properties":{"id":{"type":"string"},"label":{"type":"string"},"presets":{"items":{"$ref":"#/$defs/PresetInfo"},"type":"array"},"settings":{"items":{"$ref":"#/$defs/SettingInfo"},"type":"array"},"summary":{"type":"string"}},"required":["id","label","summary"],"type":"object"},
  "Welcome": {"properties":{"cameras":{"items":{"$ref":"#/$defs/NamedPose"},"type":"array"},"center":{"items":{"type":"number"},"maxItems":3,"minItems":3,"type":"array"},"conn":{"type":"string"},"device":{"type":"string"},"grace_ms":{"type":"integer"},"limits":{"$ref":"#/$defs/Limits"},"outputs":{"default":[],"items":{"$ref":"#/$defs/OutputInfo"},"type":"array"},"radius":{"type":"number"},"resume_token":{"type":"string"},"server":{"type":"string"},"server_ms":{"type":"number"},"session":{"$ref":"#/$defs/SessionInfo"},"techniques":{"items":{"$ref":"#/$defs/TechniqueInfo"},"type":"array"},"v":{"type":"integer"},"warnings":{"items":{"type":"string"},"type":"array"}},"required":["v","conn","session","limits","techniques","cameras","center","radius","warnings","server_ms","resume_token","grace_ms","server","device"],"type":"object"},
};

/** @type {Record<string, import('./check.js').Schema>} */
export const messages = {
  "welcome": {"$ref":"#/$defs/Welcome","properties":{"t":{"type":"string"}},"required":["t"],"type":"object"},
  "lights": {"properties":{"emissive_strength":{"type":"number"},"environment_strength":{"type":"number"},"has_environment":{"type":"boolean"},"lights":{"items":{"$ref":"#/$defs/Light"},"type":"array"},"scene_rev":{"type":"integer"},"t":{"type":"string"}},"required":["t","scene_rev","lights","environment_strength","emissive_strength","has_environment"],"type":"object"},
  "stats": {"$ref":"#/$defs/Stats","properties":{"t":{"type":"string"}},"required":["t"],"type":"object"},
  "notice": {"properties":{"detail":{"type":"string"},"kind":{"$ref":"#/$defs/NoticeKind"},"t":{"type":"string"}},"required":["t","kind","detail"],"type":"object"},
  "ok": {"properties":{"re":{"type":"integer"},"t":{"type":"string"}},"required":["t","re"],"type":"object"},
  "picked": {"properties":{"object":{"type":["string","null"]},"position":{"items":{"type":"number"},"maxItems":3,"minItems":3,"type":["array","null"]},"re":{"type":["integer","null"]},"t":{"type":"string"}},"required":["t"],"type":"object"},
  "inspected": {"properties":{"inspection":{"anyOf":[{"$ref":"#/$defs/Inspection"},{"type":"null"}]},"re":{"type":["integer","null"]},"t":{"type":"string"}},"required":["t"],"type":"object"},
  "error": {"properties":{"code":{"type":"string"},"detail":{"type":"string"},"re":{"type":["integer","null"]},"t":{"type":"string"}},"required":["t","code","detail"],"type":"object"},
  "ping": {"properties":{"t":{"type":"string"},"ts":{"type":"number"}},"required":["t","ts"],"type":"object"},
  "pong": {"properties":{"server_ms":{"type":"number"},"t":{"type":"string"},"ts":{"type":"number"}},"required":["t","ts","server_ms"],"type":"object"},
};
