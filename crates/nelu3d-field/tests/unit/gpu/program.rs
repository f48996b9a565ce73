use crate::gpu::test_device::{test_gpu, test_gpu_alone};
use nelu3d_field::device::DeviceError;
use nelu3d_field::gpu::program::{Constants, FOLD, Kernels, folded};

const DOUBLE: &str = "
    @group(0) @binding(0) var<storage, read> x: array<f32>;
    @group(0) @binding(1) var<storage, read_write> y: array<f32>;
    @compute @workgroup_size(64)
    fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_id) lid: vec3<u32>) {
        let i = (wid.y * FOLD + wid.x) * 64u + lid.x;
        if (i < N) { y[i] = 2.0 * x[i] + y[i]; }
    }";

#[test]
fn calls_run_in_order_on_every_value() {
    let Some(gpu) = test_gpu() else { return };
    // More workgroups than fit into one dimension.
    let n = FOLD * 64 + 1000;
    let values: Vec<f32> = (0..n).map(|i| (i % 1000) as f32).collect();
    let (x, y) = (gpu.upload("x", &values).unwrap(), gpu.zeros::<f32>("y", n).unwrap());
    let mut kernels = Kernels::new(&gpu);
    let double = kernels.get("double", DOUBLE, &Constants::default().count("N", n).count("FOLD", FOLD)).unwrap();
    let call = kernels.call(&double, folded(n, 64), &[&x, &y]).unwrap();
    gpu.submit(&[&[call.clone(), call]]).unwrap();
    let out = gpu.read(&y, n).unwrap();
    assert!(out.iter().zip(&values).all(|(y, x)| *y == 4.0 * x));
}

#[test]
fn what_is_too_large_is_refused_before_it_is_tried() {
    let Some(gpu) = test_gpu() else { return };
    let n = gpu.max_buffer_bytes() as usize / 4 + 1;
    let e = gpu.zeros::<f32>("the cost volume", n).unwrap_err().to_string();
    assert!(e.contains("the cost volume") && e.contains("MB") && e.contains("--device cpu"), "{e}");
    gpu.check().unwrap();
}

#[test]
fn too_many_workgroups_are_refused_before_they_are_tried() {
    let Some(gpu) = test_gpu() else { return };
    let (x, y) = (gpu.upload("x", &[1.0f32; 8]).unwrap(), gpu.zeros::<f32>("y", 8).unwrap());
    let constants = Constants::default().count("N", 8).count("FOLD", FOLD);
    let groups = [gpu.max_groups() as usize + 1, 1, 1];
    let e = Kernels::new(&gpu).run("double", DOUBLE, &constants, groups, &[&x, &y]).unwrap_err().to_string();
    assert!(e.contains("double") && e.contains("--samples") && e.contains("--device cpu"), "{e}");
    gpu.check().unwrap();
}

#[test]
fn a_faulty_kernel_is_an_error_and_a_lost_device_too() {
    let Some(gpu) = test_gpu_alone() else { return };
    let e = Kernels::new(&gpu).get("faulty", "fn main( {", &Constants::default()).unwrap_err().to_string();
    assert!(e.contains("report"), "{e}");
    let Some(gpu) = test_gpu_alone() else { return };
    let buffer = gpu.upload("x", &[1.0f32; 8]).unwrap();
    gpu.destroy();
    let e = gpu.read(&buffer, 8).unwrap_err();
    assert!(matches!(e, DeviceError::Lost { .. }), "{e:?}");
    assert!(gpu.check().is_err() && e.to_string().contains("--device cpu"), "{e}");
}
