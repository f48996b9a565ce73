//! What an interrupted training of a surface needs.

use super::neural::NeuralSurface;
use crate::state::{TrainingState, read_floats, write_floats};
use std::io::{self, Read, Write};

impl TrainingState for NeuralSurface {
    fn save(&self, out: &mut dyn Write) -> io::Result<()> {
        self.field.save(out)?;
        let moments = &self.sharpness_moments;
        write_floats(out, &[self.sharpness, moments.first[0], moments.second[0]])
    }

    fn load(&mut self, from: &mut dyn Read) -> io::Result<()> {
        self.field.load(from)?;
        let mut values = [0.0; 3];
        read_floats(from, &mut values)?;
        let moments = &mut self.sharpness_moments;
        [self.sharpness, moments.first[0], moments.second[0]] = values;
        Ok(())
    }
}
