//! How the program is started again: for a step of an experiment, and in a job of a cluster.

use std::ffi::OsString;
use std::path::PathBuf;

use anyhow::{Context as _, Result};

/// What this program is, so that it can be started again and told from another build of it.
#[derive(Clone, Debug)]
pub enum Program {
    /// The executable of this process.
    Executable,
    /// A module that a Python interpreter runs: `interpreter -m name`.
    Module {
        /// The interpreter. Empty if it does not know where it is: then commands that start the program again fail.
        interpreter: PathBuf,
        /// The module's name.
        name: String,
        /// The file that holds the compiled code.
        code: PathBuf,
    },
}

impl Program {
    /// Returns the words that stand before the arguments where the program is started: a path, and what it takes first.
    ///
    /// # Errors
    ///
    /// The system, or the interpreter, does not tell where it is.
    pub(crate) fn command(&self) -> Result<Vec<OsString>> {
        match self {
            Self::Executable => Ok(vec![executable()?.into()]),
            Self::Module { interpreter, .. } if interpreter.as_os_str().is_empty() => {
                anyhow::bail!("Python does not tell where its interpreter is; run this command as `python3 -m nelu3d`")
            }
            Self::Module { interpreter, name, .. } => Ok(vec![interpreter.into(), "-m".into(), name.into()]),
        }
    }

    /// Returns the file whose content decides what the program does.
    ///
    /// # Errors
    ///
    /// The system does not tell where it is.
    pub(crate) fn code(&self) -> Result<PathBuf> {
        match self {
            Self::Executable => executable(),
            Self::Module { code, .. } => Ok(code.clone()),
        }
    }
}

fn executable() -> Result<PathBuf> {
    std::env::current_exe().context("this program cannot find itself")
}
