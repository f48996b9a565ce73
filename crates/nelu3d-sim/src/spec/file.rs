//! Spec files.

use std::path::Path;

use nelu3d_scan::input::{read_text, toml_reason};

use super::error::SpecError;
use super::film::FilmSpec;
use super::light::LightSpec;
use super::simulation::Spec;

impl Spec {
    /// Reads a TOML file without checking its values. Files that it names are looked for from its folder.
    pub(crate) fn parse(path: &Path) -> Result<Self, SpecError> {
        let text = read_text(path).map_err(|source| SpecError::Io { path: path.into(), source })?;
        let mut spec: Self =
            toml::from_str(&text).map_err(|e| SpecError::Syntax { reason: toml_reason(&e, &text) }.in_file(path))?;
        // Files lie beside the spec that names them.
        let dir = path.parent().unwrap_or(Path::new(""));
        if let LightSpec::Film(FilmSpec { image: Some(image), .. }) = &mut spec.light {
            *image = dir.join(&*image);
        }
        let moving = spec.sequences.iter_mut().flat_map(|s| &mut s.objects).map(|o| &mut o.object);
        for object in spec.scenes.iter_mut().flat_map(|s| &mut s.objects).chain(moving) {
            object.resolve(dir);
        }
        Ok(spec)
    }

    /// Returns the spec as a TOML file.
    pub fn to_toml(&self) -> String {
        // Erased, every section is compiled once, not for each of the writer's five serializers.
        let erased: &dyn erased_serde::Serialize = self;
        toml::to_string(erased).expect("a spec is plain data with string keys")
    }
}
