//! Calls that run one after the other.

use super::super::adapter::Gpu;
use super::kernels::Call;
use crate::device::DeviceError;

impl Gpu {
    /// Starts calls, one after the other; each sees what those before it wrote. Does not wait.
    #[doc(hidden)]
    pub fn submit(&self, calls: &[&[Call]]) -> Result<(), DeviceError> {
        let mut encoder = self.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            for call in calls.iter().copied().flatten() {
                pass.set_pipeline(&call.kernel.pipeline);
                pass.set_bind_group(0, &call.bindings, &[]);
                let [x, y, z] = call.groups;
                pass.dispatch_workgroups(x, y, z);
            }
        }
        self.queue.submit([encoder.finish()]);
        self.check()
    }
}
