//! Arguments of `manual`.

use std::path::PathBuf;

/// Arguments of `nelu3d manual`.
#[derive(Debug, clap::Args)]
pub(crate) struct ManualArgs {
    /// Folder to write into: man1/ and completions/.
    pub output: PathBuf,
}
