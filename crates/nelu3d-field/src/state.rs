//! The state of a training as bytes: what an interrupted training needs to go on as if nothing had happened.
//!
//! Values are written as they are in memory, little-endian and without a description: they are read back into an object
//! of the same configuration, which knows how many there must be. Whether that is the right one, and whether the bytes
//! are whole, is the business of whoever keeps the file.

use std::io::{self, Read, Write};

/// An object whose training can be interrupted: written and read back, it goes on bit for bit as it would have.
pub trait TrainingState {
    /// Writes everything that the training changes.
    ///
    /// # Errors
    /// Those of `out`.
    fn save(&self, out: &mut dyn Write) -> io::Result<()>;

    /// Reads what [`Self::save`] wrote of an object of the same configuration.
    ///
    /// # Errors
    /// Those of `from`; [`io::ErrorKind::InvalidData`] if it belongs to another configuration. The object is then of no
    /// use any more.
    fn load(&mut self, from: &mut dyn Read) -> io::Result<()>;
}

/// Writes a number.
///
/// # Errors
/// Those of `out`.
pub fn write_u64(out: &mut dyn Write, value: u64) -> io::Result<()> {
    out.write_all(&value.to_le_bytes())
}

/// Reads a number.
///
/// # Errors
/// Those of `from`.
pub fn read_u64(from: &mut dyn Read) -> io::Result<u64> {
    let mut bytes = [0; 8];
    from.read_exact(&mut bytes)?;
    Ok(u64::from_le_bytes(bytes))
}

/// Values that are converted at once.
const CHUNK: usize = 4096;

/// Writes values, after their number.
///
/// # Errors
/// Those of `out`.
pub fn write_floats(out: &mut dyn Write, values: &[f32]) -> io::Result<()> {
    write_u64(out, values.len() as u64)?;
    let mut bytes = Vec::with_capacity(4 * CHUNK);
    for values in values.chunks(CHUNK) {
        bytes.clear();
        values.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
        out.write_all(&bytes)?;
    }
    Ok(())
}

/// Reads as many values as there are in `values`.
///
/// # Errors
/// Those of `from`; [`io::ErrorKind::InvalidData`] if another number was written.
pub fn read_floats(from: &mut dyn Read, values: &mut [f32]) -> io::Result<()> {
    if read_u64(from)? != values.len() as u64 {
        return Err(other_configuration());
    }
    let mut bytes = [0; 4 * CHUNK];
    for values in values.chunks_mut(CHUNK) {
        let bytes = &mut bytes[..4 * values.len()];
        from.read_exact(bytes)?;
        for (value, bytes) in values.iter_mut().zip(bytes.as_chunks::<4>().0) {
            *value = f32::from_le_bytes(*bytes);
        }
    }
    Ok(())
}

/// Returns the error of a state that belongs to an object of another configuration.
pub fn other_configuration() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, "the training's state is of another configuration")
}
