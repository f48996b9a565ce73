//! What an interrupted training of a field needs.

use super::field::HashField;
use crate::adam::MomentBuffers;
use crate::field::training::Training;
use crate::mlp::weight_norm;
use crate::state::{TrainingState, read_floats, read_u64, write_floats, write_u64};
use std::io::{self, Read, Write};

impl<const D: usize> TrainingState for HashField<D> {
    fn save(&self, out: &mut dyn Write) -> io::Result<()> {
        write_floats(out, &self.params)?;
        let training = self.training.as_deref().filter(|t| t.n_steps > 0);
        write_u64(out, training.map_or(0, |t| t.n_steps))?;
        let Some(Training { moments, raw: [raw, _], .. }) = training else { return Ok(()) };
        write_floats(out, raw)?;
        write_floats(out, &moments.first)?;
        write_floats(out, &moments.second)
    }

    fn load(&mut self, from: &mut dyn Read) -> io::Result<()> {
        read_floats(from, &mut self.params)?;
        let n_steps = read_u64(from)?;
        self.training = None;
        if n_steps > 0 {
            let n_network = self.mlp.n_params();
            let is_normalized = self.config.training.weight_normalization;
            let mut raw = vec![0.0; if is_normalized { weight_norm::n_raw(&self.mlp) } else { 0 }];
            read_floats(from, &mut raw)?;
            let n_optimized = if is_normalized { raw.len() } else { n_network };
            let mut moments = MomentBuffers::new(self.params.len() - n_network + n_optimized);
            read_floats(from, &mut moments.first)?;
            read_floats(from, &mut moments.second)?;
            self.training = Some(Box::new(Training::restored(n_steps, moments, raw)));
        }
        self.packed.pack(&self.params[self.grid.n_params()..]);
        Ok(())
    }
}
