//! Whether a spec makes sense: one file per section, in the order in which their errors are found.

mod board;
mod camera;
mod light;
mod object;
mod rules;
mod sequence;
mod staging;

use std::collections::HashSet;
use std::path::Path;

use crate::spec::{Spec, SpecError};
use board::{check_board, check_sweep};
use camera::check_camera;
use light::check_light;
use object::check_object;
use rules::{name, within};
use sequence::check_sequence;
use staging::check_staging;

impl Spec {
    /// Reads a TOML file and checks its values. Files that it names are looked for from its folder, and are read.
    ///
    /// # Errors
    ///
    /// The file cannot be read, is not TOML, has an unknown key, or a value that makes no sense; the message names the
    /// file, the key and a remedy.
    pub fn read(path: &Path) -> Result<Self, SpecError> {
        let spec = Self::parse(path)?;
        spec.check().map_err(|e| e.in_file(path))?;
        Ok(spec)
    }

    /// Checks every value.
    ///
    /// # Errors
    ///
    /// The first value that makes no sense, with its key and a remedy.
    pub fn check(&self) -> Result<(), SpecError> {
        within("supersampling", self.supersampling as f64, 1.0, 16.0)?;
        within("ambient", self.ambient, 0.0, 1e3)?;
        within("interreflection.bounces", self.interreflection.bounces as f64, 0.0, 64.0)?;
        within("interreflection.paths_per_pixel", self.interreflection.paths_per_pixel as f64, 1.0, 1e5)?;
        check_camera(&self.camera)?;
        check_light(self)?;
        check_board(self)?;
        check_sweep(self)?;
        let mut names = HashSet::new();
        for scene in &self.scenes {
            name("scenes.name", &scene.name, &mut names)?;
            check_staging(self, scene)?;
            for object in &scene.objects {
                check_object(&format!("scenes `{}`", scene.name), object)?;
            }
        }
        names.clear();
        for sequence in &self.sequences {
            name("sequences.name", &sequence.name, &mut names)?;
            check_sequence(self, sequence)?;
        }
        Ok(())
    }
}
