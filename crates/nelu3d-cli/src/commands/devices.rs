//! `nelu3d devices`: what there is to compute on.

use anyhow::Result;
use nelu3d_field::device::{self, Choice, Device, Found};

use crate::context::CommandContext;

/// Runs the command.
pub(crate) fn run(context: &CommandContext) -> Result<()> {
    let found = device::list();
    let automatic = found.iter().find(|f| f.automatic).map_or(Choice::Cpu, |f| f.device);
    // Listed is not opened.
    let opens = Device::open(Choice::Auto)?.is_cpu() == (automatic == Choice::Cpu);
    let answer = serde_json::json!({
        "gpu_code": device::has_gpu_code(),
        "gpus": found,
        "auto": if opens { automatic } else { Choice::Cpu },
    });
    context.answer(&answer, || {
        let mut text: String = found.iter().map(line).collect();
        text += &format!("cpu     {} threads\n", rayon::current_num_threads());
        if !device::has_gpu_code() {
            text += "\nThis build has no GPU code. To have it:\n  cargo install --path crates/nelu3d-cli --features gpu\n";
        } else if found.is_empty() {
            text += "\nNo GPU: no driver for Vulkan, Metal or Direct3D 12 was found. On Debian and Ubuntu the loader is in \
                     libvulkan1,\nthe drivers are in mesa-vulkan-drivers (AMD, Intel, software) and in NVIDIA's own packages.\n";
        } else if !opens {
            text += &format!("\n{automatic} was found but cannot be opened; `--device {automatic}` says why.\n");
        }
        text + &format!("\n--device auto takes {}\n", if opens { automatic } else { Choice::Cpu })
    })?;
    Ok(())
}

/// Describes a GPU.
fn line(found: &Found) -> String {
    let Found { device, name, kind, backend, driver, max_buffer_bytes, features, unusable, automatic } = found;
    let device = device.to_string();
    let mut text = format!(
        "{device:<7} {name}: {kind}, {backend}, driver {driver}, buffers up to {} MB",
        max_buffer_bytes / 1_000_000
    );
    for feature in features {
        text += &format!(", {feature}");
    }
    text.push('\n');
    match unusable {
        Some(reason) => text += &format!("        cannot be used: too little of {reason}\n"),
        None if !automatic => {
            text += "        not taken by --device auto: a software driver, which does on the CPU what the CPU's own code does faster\n";
        }
        None => {}
    }
    text
}
