//! Failures of a device.

use super::choice::Choice;

/// Returns a number of bytes for people.
fn amount(bytes: u64) -> String {
    if bytes < 1_000_000 { format!("{bytes} bytes") } else { format!("{} MB", bytes.div_ceil(1_000_000)) }
}

/// Returns in which way a buffer is too large, for the bytes of the largest one; 0 if its memory as a whole was too small.
fn excess(max: u64) -> String {
    if max > 0 { format!("more than the {} that there are", amount(max)) } else { "which is not free there".into() }
}

/// Why there is no device, or no longer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DeviceError {
    /// The program has no GPU code in it.
    #[error(
        "--device {0}: this build has no GPU code; build with `--features gpu` (cargo install \
         --path crates/nelu3d-cli --features gpu), or use --device cpu"
    )]
    NotBuilt(Choice),
    /// No such device.
    #[error("--device {choice}: {reason}; see `nelu3d devices`, or use --device cpu")]
    None {
        /// The device that was asked for.
        choice: Choice,
        /// Why there is none.
        reason: String,
    },
    /// A buffer does not fit.
    #[error(
        "{device}: {what} needs {}, {}; use a smaller problem (--samples, --max-labels), another --device, or \
         --device cpu",
        amount(*needed),
        excess(*max)
    )]
    Memory {
        /// The device.
        device: String,
        /// The purpose of the buffer.
        what: String,
        /// Bytes that are needed.
        needed: u64,
        /// Bytes of the largest buffer; 0 if its memory as a whole was too small.
        max: u64,
    },
    /// A kernel would need more workgroups than can be started at once.
    #[error(
        "{device}: `{what}` would take {asked} workgroups, and {max} is the most there; use \
         fewer --samples, another --device, or --device cpu"
    )]
    Size {
        /// The device.
        device: String,
        /// The kernel.
        what: String,
        /// Workgroups along an axis.
        asked: usize,
        /// The most there are.
        max: usize,
    },
    /// The device stopped answering.
    #[error("{device}: the device was lost ({reason}); run again, or use --device cpu")]
    Lost {
        /// The device.
        device: String,
        /// The driver's message.
        reason: String,
    },
    /// A fault of this program or of the driver.
    #[error("{device}: {reason}; please report this, and use --device cpu")]
    Failed {
        /// The device.
        device: String,
        /// The driver's message.
        reason: String,
    },
}
