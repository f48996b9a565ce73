//! How far a training is.

use std::io::{self, ErrorKind, Read, Write};

use nelu3d_field::state::{read_u64, write_u64};

use super::super::config::FIRST_RAYS;
use super::super::record::TrainingRecord;

/// Largest number of records that a file may state, far beyond any.
const MAX_RECORDS: u64 = 1 << 20;

/// How far a training is.
#[derive(Clone, Debug, PartialEq)]
pub struct Reached {
    /// Number of iterations that are done.
    pub done: usize,
    /// Number of rays of the next one.
    pub n_rays: usize,
    /// Records so far.
    pub records: Vec<TrainingRecord>,
}

impl Default for Reached {
    /// Nothing is done yet.
    fn default() -> Self {
        Self { done: 0, n_rays: FIRST_RAYS, records: Vec::new() }
    }
}

impl Reached {
    pub(super) fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        for n in [self.done, self.n_rays, self.records.len()] {
            write_u64(out, n as u64)?;
        }
        for record in &self.records {
            for n in [record.iteration, record.rays, record.samples] {
                write_u64(out, n as u64)?;
            }
            let TrainingRecord { image, mask, eikonal, sparsity, inv_s_per_mm, occupied, .. } = *record;
            for v in [image, mask, eikonal, sparsity, inv_s_per_mm, occupied] {
                write_u64(out, v.to_bits())?;
            }
        }
        Ok(())
    }

    pub(super) fn read(from: &mut dyn Read) -> io::Result<Self> {
        let (done, n_rays, n_records) = (read_count(from)?, read_count(from)?, read_u64(from)?);
        if n_records > MAX_RECORDS {
            return Err(ErrorKind::InvalidData.into());
        }
        let mut records = Vec::new();
        for _ in 0..n_records {
            let (iteration, rays, samples) = (read_count(from)?, read_count(from)?, read_count(from)?);
            let mut value = || read_u64(from).map(f64::from_bits);
            records.push(TrainingRecord {
                iteration,
                image: value()?,
                mask: value()?,
                eikonal: value()?,
                sparsity: value()?,
                inv_s_per_mm: value()?,
                rays,
                samples,
                occupied: value()?,
            });
        }
        Ok(Self { done, n_rays, records })
    }
}

fn read_count(from: &mut dyn Read) -> io::Result<usize> {
    usize::try_from(read_u64(from)?).map_err(|_| ErrorKind::InvalidData.into())
}
