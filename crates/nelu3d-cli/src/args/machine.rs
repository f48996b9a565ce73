//! Arguments of `bench`.

use nelu3d_field::device::Choice;

/// Arguments of `nelu3d bench`.
#[derive(Debug, clap::Args)]
pub(crate) struct BenchArgs {
    /// Only kernels and steps with this in their name; "step" for all training steps, "fast" for recipe `fast` on a
    /// virtual rig.
    #[arg(default_value = "")]
    pub filter: String,
    /// Processor seconds for each kernel and step; on a GPU, seconds for each phase of a step of recipe `paper`.
    #[arg(long, value_name = "S", default_value_t = 0.5, value_parser = seconds)]
    pub seconds: f64,
    /// Device that is measured: cpu, or a GPU, as gpu or gpu:N of `nelu3d devices`.
    #[arg(long, default_value_t = Choice::Cpu)]
    pub device: Choice,
    /// Number of samples of the step on a GPU.
    #[arg(long, value_name = "N", default_value_t = 262_144, value_parser = clap::value_parser!(usize))]
    pub samples: usize,
}

/// Parses a time.
fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(secs) if (0.0..=60.0).contains(&secs) => Ok(secs),
        _ => Err("a number from 0 to 60".into()),
    }
}
