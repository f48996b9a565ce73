use crate::gpu::test_device::test_gpu;
use nelu3d_field::gpu::GpuReport;

#[test]
fn everything_is_measured() {
    let Some(gpu) = test_gpu() else { return };
    let report = GpuReport::measure(&gpu, 1 << 10, 1e-3).unwrap();
    assert!(report.flops_per_sec > 1e7 && report.bytes_per_sec > 1e7, "{report}");
    assert!(report.n_samples > 200 && report.memory_bytes > 100_000_000, "{report}");
    assert!(report.phases.len() >= 6 && report.phases.iter().all(|p| p.secs > 0.0 && p.bytes > 0.0), "{report}");
    assert!(report.to_string().lines().count() > report.phases.len());
}
