//! Reference images on disk: `<scene>_<camera>_<mode>.exr` with a JSON of the same name.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::{MeasureError, Rectangle};

/// How the reference was rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Every surface a two-sided Lambertian of its base colour.
    Lambert,
    /// glTF metallic-roughness.
    Pbr,
    /// Lambertian surfaces; the image is `irradiance_over_pi` of indirect light, without the first albedo.
    Indirect,
}

/// Analytically known colours, from the scene's own file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Expected {
    /// Every pixel whose reference lies near one of these has exactly that colour.
    pub colors: Vec<[f64; 3]>,
}

/// One reference and what is needed to render the same image.
#[derive(Clone, Debug)]
pub struct Reference {
    /// `<scene>_<camera>_<mode>`.
    pub name: String,
    /// The image.
    pub image: PathBuf,
    /// The scene's `.glb`.
    pub scene: PathBuf,
    /// Camera in the scene's view file.
    pub camera: String,
    /// Materials and output.
    pub mode: Mode,
    /// Pixels.
    pub size: [u32; 2],
    /// Factor of the error metric, not part of the pixel values.
    pub exposure: f64,
    /// Tone-mapped RMSE of the image itself.
    pub noise_rmse: f64,
    /// RMSE of linear values of the image itself.
    pub noise_rmse_linear: f64,
    /// Parts in which other renderers are known to differ by design.
    pub masked: Vec<Rectangle>,
    /// Analytic values.
    pub expected: Expected,
}

/// The folder of shared scenes and references: `SURFELCAST_SHARED`, else `shared` in the given folder; `None` if
/// there is none.
pub fn shared_folder(parent: &Path) -> Option<PathBuf> {
    let folder = std::env::var_os("SURFELCAST_SHARED").map_or_else(|| parent.join("shared"), PathBuf::from);
    folder.join("references").is_dir().then_some(folder)
}

impl Reference {
    /// All references of a folder that holds `references/` and `scenes/`, sorted by name.
    pub fn read_all(shared: &Path) -> Result<Vec<Self>, MeasureError> {
        let folder = shared.join("references");
        let masks = read_json(&shared.join("peers/masks.json")).unwrap_or(Value::Null);
        let entries = fs::read_dir(&folder).and_then(Iterator::collect::<Result<Vec<_>, _>>);
        let entries = entries.map_err(|error| MeasureError::file(&folder, &error))?;
        let mut files: Vec<_> = entries.iter().map(fs::DirEntry::path).collect();
        files.retain(|file| file.extension().is_some_and(|extension| extension == "json"));
        files.sort();
        files.iter().map(|file| Self::read(file, shared, &masks)).collect()
    }

    fn read(file: &Path, shared: &Path, masks: &Value) -> Result<Self, MeasureError> {
        let json = read_json(file)?;
        let fault = |field: &str, what: &str| MeasureError::file(file, &format!("{field} is {what}"));
        let text = |field: &str| json[field].as_str().ok_or_else(|| fault(field, "no string"));
        let number = |value: &Value, field: &str| value.as_f64().ok_or_else(|| fault(field, "no number"));
        let (scene, camera) = (text("scene")?, text("camera")?);
        let view = read_json(&shared.join(format!("scenes/{scene}.json")))?;
        let mode = match text("mode")? {
            "lambert" => Mode::Lambert,
            "pbr" => Mode::Pbr,
            "indirect" => Mode::Indirect,
            _ => return Err(fault("mode", "not lambert, pbr or indirect")),
        };
        let side = |index: usize| {
            let side = json["resolution"][index].as_u64().and_then(|side| u32::try_from(side).ok());
            side.ok_or_else(|| fault("resolution", "no size"))
        };
        Ok(Self {
            name: format!("{scene}_{camera}_{}", text("mode")?),
            image: file.with_extension("exr"),
            scene: shared.join(format!("scenes/{scene}.glb")),
            camera: camera.to_owned(),
            mode,
            size: [side(0)?, side(1)?],
            exposure: number(&json["exposure"], "exposure")?,
            noise_rmse: number(&json["noise"]["rmse_tm"], "noise.rmse_tm")?,
            noise_rmse_linear: number(&json["noise"]["rmse"], "noise.rmse")?,
            masked: rectangles(&masks[format!("{scene}_{camera}")]),
            expected: Expected { colors: colors(&view["expected"]) },
        })
    }
}

fn read_json(path: &Path) -> Result<Value, MeasureError> {
    let text = fs::read_to_string(path).map_err(|error| MeasureError::file(path, &error))?;
    serde_json::from_str(&text).map_err(|error| MeasureError::file(path, &error))
}

fn rectangles(value: &Value) -> Vec<Rectangle> {
    let corner = |value: &Value| value.as_u64().and_then(|value| usize::try_from(value).ok());
    let list = value.as_array().map(Vec::as_slice).unwrap_or_default();
    list.iter()
        .filter_map(|one| {
            Some(Rectangle { start: [corner(&one[0])?, corner(&one[1])?], end: [corner(&one[2])?, corner(&one[3])?] })
        })
        .collect()
}

/// The values of an object such as `{"object": [0.8, 0.8, 0.8], "background": [1, 1, 1]}`; anything else has none.
fn colors(value: &Value) -> Vec<[f64; 3]> {
    let triple = |value: &Value| Some([value[0].as_f64()?, value[1].as_f64()?, value[2].as_f64()?]);
    value.as_object().map(|object| object.values().filter_map(triple).collect()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_masks_and_expected_colors() {
        let value = serde_json::json!({"main": [[1, 2, 3, 4], ["x", 0, 0, 0]]});
        assert_eq!(rectangles(&value["main"]), [Rectangle { start: [1, 2], end: [3, 4] }]);
        assert_eq!(rectangles(&value["absent"]), []);
        let value = serde_json::json!({"constant": [1, 1, 1], "points": [[0, 0]], "text": "x"});
        assert_eq!(colors(&value), [[1.0; 3]]);
    }

    #[test]
    fn reads_every_reference() -> Result<(), MeasureError> {
        let Some(shared) = shared_folder(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..")) else {
            println!("skipped: no folder of references; set SURFELCAST_SHARED to one");
            return Ok(());
        };
        let references = Reference::read_all(&shared)?;
        assert!(references.len() > 20, "{} references", references.len());
        for reference in references {
            let image = crate::Image::read_exr(&reference.image)?;
            let [width, height] = reference.size.map(|side| side as usize);
            assert_eq!(image.size, [width, height], "{}", reference.name);
            assert_eq!(image.non_finite_count(), 0, "{}", reference.name);
            assert!(reference.noise_rmse > 0.0 && reference.noise_rmse < 0.05, "{}", reference.name);
        }
        Ok(())
    }
}
