//! Arguments of `demo` and `simulate`: virtual scanners.

use std::path::PathBuf;

use nelu3d_field::device::Choice;

/// Arguments of `nelu3d demo`.
#[derive(Debug, clap::Args)]
pub(crate) struct DemoArgs {
    /// Folder to write, new or left by an earlier demo.
    #[arg(short, long, value_name = "DIR", default_value = "nelu3d-demo")]
    pub output: PathBuf,
    /// Where the heavy work is done: auto (a GPU, if there is one), cpu, gpu, or gpu:N as in `nelu3d devices`.
    #[arg(long, default_value_t)]
    pub device: Choice,
}

/// Arguments of `nelu3d simulate`.
#[derive(Debug, clap::Args)]
pub(crate) struct SimulateArgs {
    /// Name of a preset, or a file that describes a scanner (.toml).
    #[arg(value_name = "PRESET|SPEC.toml")]
    pub spec: String,
    /// Rig folder to write.
    #[arg(short, long, value_name = "RIG")]
    pub output: PathBuf,
}
