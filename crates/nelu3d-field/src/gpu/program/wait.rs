//! Waiting for the device.

use super::super::adapter::Gpu;
use crate::device::DeviceError;
use std::time::Duration;

/// How long one submission may take before the device counts as lost.
pub(super) const PATIENCE: Duration = Duration::from_secs(120);

impl Gpu {
    /// Waits for everything submitted.
    pub(crate) fn wait(&self) -> Result<(), DeviceError> {
        let result = self.device.poll(wgpu::PollType::Wait { submission_index: None, timeout: Some(PATIENCE) });
        if result.is_err() {
            let reason = format!("no answer in {} s", PATIENCE.as_secs());
            return Err(self.fail(DeviceError::Lost { device: self.name().to_owned(), reason }));
        }
        self.check()
    }
}
