//! The file.

use std::io::{self, BufReader, ErrorKind, Read, Write};
use std::path::PathBuf;

use nelu3d_field::state::{TrainingState, read_u64, write_u64};
use nelu3d_scan::input::open_file;
use nelu3d_scan::output::write_atomic;
use sha2::{Digest, Sha256};

use super::error::TrainingCheckpointError;
use super::hashing::{HashingReader, HashingWriter};
use super::identity::Identity;
use super::reached::Reached;

/// How a file begins: what it is, and the version of its layout.
const MAGIC: &[u8; 16] = b"nelu3d-training1";
/// Largest length of the settings that a file may state, far beyond any.
const MAX_SETTINGS: u64 = 1 << 20;

/// The checkpoint file of one training.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    path: PathBuf,
    identity: Identity,
    every: usize,
}

impl Checkpoint {
    /// Makes the checkpoint of a training, to be written every `every` iterations.
    pub fn new(path: PathBuf, identity: Identity, every: usize) -> Self {
        Self { path, identity, every: every.max(1) }
    }

    /// Returns whether it is to be written after this many iterations.
    pub fn is_due(&self, done: usize) -> bool {
        done.is_multiple_of(self.every)
    }

    /// Reads the state of the parts, in the order in which they were saved; `None` if there is no file.
    ///
    /// # Errors
    ///
    /// The file cannot be read, is damaged, or belongs to another training. The parts are then of no use any more.
    pub fn load(&self, parts: &mut [&mut dyn TrainingState]) -> Result<Option<Reached>, TrainingCheckpointError> {
        let file = match open_file(&self.path) {
            Ok((file, _)) => file,
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(self.unreadable(e)),
        };
        let mut from = HashingReader { inner: BufReader::with_capacity(1 << 16, file), hash: Sha256::new() };
        let other = |what| Err(TrainingCheckpointError::Other { path: self.path.clone(), what });
        let identity = self.whole(read_identity(&mut from))?;
        if identity.settings != self.identity.settings {
            return other("other settings or by another version");
        }
        if identity.scene != self.identity.scene {
            return other("another scene, camera, pattern set or color field");
        }
        let reached = self.whole(Reached::read(&mut from))?;
        for part in parts {
            self.whole(part.load(&mut from))?;
        }
        let expected = from.hash.finalize();
        let mut found = [0; 32];
        self.whole(from.inner.read_exact(&mut found))?;
        if found[..] != expected[..] {
            return Err(TrainingCheckpointError::Damaged { path: self.path.clone() });
        }
        Ok(Some(reached))
    }

    /// Writes the state of the parts.
    ///
    /// # Errors
    ///
    /// The file cannot be written; what was there before stays.
    pub fn save(&self, reached: &Reached, parts: &[&dyn TrainingState]) -> Result<(), TrainingCheckpointError> {
        let write = |out: &mut dyn Write| {
            let mut out = HashingWriter { inner: out, hash: Sha256::new() };
            out.write_all(MAGIC)?;
            write_u64(&mut out, self.identity.settings.len() as u64)?;
            out.write_all(self.identity.settings.as_bytes())?;
            out.write_all(&self.identity.scene)?;
            reached.write(&mut out)?;
            parts.iter().try_for_each(|part| part.save(&mut out))?;
            let HashingWriter { inner, hash } = out;
            inner.write_all(&hash.finalize())
        };
        write_atomic(&self.path, write).map_err(TrainingCheckpointError::Write)
    }

    /// Removes the file of a training that is finished; what cannot be removed stays.
    pub fn remove(&self) {
        let _ = std::fs::remove_file(&self.path);
    }

    fn unreadable(&self, source: io::Error) -> TrainingCheckpointError {
        TrainingCheckpointError::Read { path: self.path.clone(), source }
    }

    /// Tells a file that is not whole from one that cannot be read.
    fn whole<T>(&self, read: io::Result<T>) -> Result<T, TrainingCheckpointError> {
        read.map_err(|e| match e.kind() {
            ErrorKind::UnexpectedEof | ErrorKind::InvalidData => {
                TrainingCheckpointError::Damaged { path: self.path.clone() }
            }
            _ => self.unreadable(e),
        })
    }
}

/// Reads who a file belongs to.
fn read_identity(from: &mut dyn Read) -> io::Result<Identity> {
    let mut magic = [0; MAGIC.len()];
    from.read_exact(&mut magic)?;
    let n_settings = read_u64(from)?;
    if &magic != MAGIC || n_settings > MAX_SETTINGS {
        return Err(ErrorKind::InvalidData.into());
    }
    let mut settings = vec![0; n_settings as usize];
    from.read_exact(&mut settings)?;
    let settings = String::from_utf8(settings).map_err(|_| ErrorKind::InvalidData)?;
    let mut scene = [0; 32];
    from.read_exact(&mut scene)?;
    Ok(Identity { settings, scene })
}
