//! Buffers, kernels, and lists of kernels that are run one after the other.

use super::Gpu;
use crate::device::DeviceError;
use bytemuck::Pod;
use std::collections::HashMap;
use std::marker::PhantomData;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use wgpu::BufferUsages;

/// Values on the device.
#[derive(Clone, Debug)]
pub(crate) struct Buffer<T = f32> {
    raw: wgpu::Buffer,
    len: usize,
    held: Arc<Held>,
    kind: PhantomData<T>,
}

/// Memory of buffers, bytes.
#[derive(Debug, Default)]
pub(super) struct Memory {
    now: AtomicU64,
    peak: AtomicU64,
}

/// Memory of one buffer, as long as there is one.
#[derive(Debug)]
pub(crate) struct Held {
    bytes: u64,
    memory: Arc<Memory>,
}

impl Held {
    fn new(bytes: u64, memory: &Arc<Memory>) -> Arc<Self> {
        let now = memory.now.fetch_add(bytes, Ordering::Relaxed) + bytes;
        memory.peak.fetch_max(now, Ordering::Relaxed);
        Arc::new(Self { bytes, memory: memory.clone() })
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        self.memory.now.fetch_sub(self.bytes, Ordering::Relaxed);
    }
}

impl<T: Pod> Buffer<T> {
    /// Number of values.
    pub(crate) fn len(&self) -> usize {
        self.len
    }
}

/// Something that a kernel can be given.
pub(crate) trait Binding {
    #[doc(hidden)]
    fn raw(&self) -> &wgpu::Buffer;
    #[doc(hidden)]
    fn held(&self) -> &Arc<Held>;
}

impl<T: Pod> Binding for Buffer<T> {
    fn raw(&self) -> &wgpu::Buffer {
        &self.raw
    }

    fn held(&self) -> &Arc<Held> {
        &self.held
    }
}

/// A kernel, compiled.
#[derive(Clone, Debug)]
pub(crate) struct Kernel {
    label: &'static str,
    pipeline: wgpu::ComputePipeline,
}

/// A kernel with its buffers and its number of workgroups.
#[derive(Clone, Debug)]
pub(crate) struct Call {
    kernel: Kernel,
    bindings: wgpu::BindGroup,
    groups: [u32; 3],
    /// The buffers live as long as there is a call that uses them.
    _held: Arc<[Arc<Held>]>,
}

impl Call {
    /// The kernel's name.
    pub(crate) fn label(&self) -> &'static str {
        self.kernel.label
    }
}

/// How long one submission may take before the device counts as lost.
const PATIENCE: Duration = Duration::from_secs(120);

impl Gpu {
    /// Bytes of all buffers that there are now.
    pub fn memory(&self) -> u64 {
        self.memory.now.load(Ordering::Relaxed)
    }

    /// Most bytes of buffers that there were at a time.
    pub fn peak_memory(&self) -> u64 {
        self.memory.peak.load(Ordering::Relaxed)
    }

    fn allocate<T: Pod>(&self, what: &str, len: usize) -> Result<Buffer<T>, DeviceError> {
        // An empty binding is no binding.
        let bytes = (len.max(4) * size_of::<T>()).next_multiple_of(4) as u64;
        let device = self.name().to_owned();
        let memory = |max| DeviceError::Memory { device, what: what.to_owned(), needed: bytes, max };
        if bytes > self.max_buffer_bytes {
            return Err(memory(self.max_buffer_bytes));
        }
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let raw = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(what),
            size: bytes,
            usage: BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        if pollster::block_on(scope.pop()).is_some() {
            return Err(memory(0));
        }
        self.check()?;
        Ok(Buffer { raw, len, held: Held::new(bytes, &self.memory), kind: PhantomData })
    }

    /// Values that are zero; `what` names them in errors.
    pub(crate) fn zeros<T: Pod>(&self, what: &str, len: usize) -> Result<Buffer<T>, DeviceError> {
        // New buffers are.
        self.allocate(what, len)
    }

    /// Values from here.
    pub(crate) fn upload<T: Pod>(&self, what: &str, values: &[T]) -> Result<Buffer<T>, DeviceError> {
        let buffer = self.allocate(what, values.len())?;
        self.write(&buffer, values);
        Ok(buffer)
    }

    /// Overwrites the first values of a buffer, before whatever is submitted next.
    pub(crate) fn write<T: Pod>(&self, buffer: &Buffer<T>, values: &[T]) {
        assert!(values.len() <= buffer.len);
        if !values.is_empty() {
            self.queue.write_buffer(&buffer.raw, 0, bytemuck::cast_slice(values));
        }
    }

    /// Waits for everything submitted, and fetches the first `len` values.
    pub(crate) fn read<T: Pod>(&self, buffer: &Buffer<T>, len: usize) -> Result<Vec<T>, DeviceError> {
        assert!(len <= buffer.len);
        let bytes = (len * size_of::<T>()) as u64;
        if bytes == 0 {
            return Ok(Vec::new());
        }
        self.check()?;
        let copy = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("copy"),
            size: bytes.next_multiple_of(4),
            usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(&buffer.raw, 0, &copy, 0, bytes.next_multiple_of(4));
        self.queue.submit([encoder.finish()]);
        let (sender, receiver) = std::sync::mpsc::channel();
        copy.map_async(wgpu::MapMode::Read, .., move |result| {
            let _ = sender.send(result.is_ok());
        });
        self.wait()?;
        let lost = || {
            let reason = "its memory could not be read".to_owned();
            self.fail(DeviceError::Lost { device: self.name().to_owned(), reason })
        };
        // Another thread that waits may be the one that is told, a moment later.
        if !matches!(receiver.recv_timeout(PATIENCE), Ok(true)) {
            return Err(lost());
        }
        let view = copy.get_mapped_range(..).map_err(|_| lost())?;
        let values = bytemuck::pod_collect_to_vec(&view[..bytes as usize]);
        drop(view);
        Ok(values)
    }

    /// Waits for everything submitted.
    pub(crate) fn wait(&self) -> Result<(), DeviceError> {
        let result = self.device.poll(wgpu::PollType::Wait { submission_index: None, timeout: Some(PATIENCE) });
        if result.is_err() {
            let reason = format!("no answer in {} s", PATIENCE.as_secs());
            return Err(self.fail(DeviceError::Lost { device: self.name().to_owned(), reason }));
        }
        self.check()
    }

    /// Starts calls, one after the other; each sees what those before it wrote. Does not wait.
    pub(crate) fn submit(&self, calls: &[&[Call]]) -> Result<(), DeviceError> {
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

/// Kernels, by their complete text.
pub(super) type Compiled = Mutex<HashMap<String, Kernel>>;

/// A device's kernels, compiled once for each set of constants.
#[derive(Debug)]
pub(crate) struct Kernels {
    gpu: Arc<Gpu>,
}

impl Kernels {
    pub(crate) fn new(gpu: &Arc<Gpu>) -> Self {
        Self { gpu: gpu.clone() }
    }

    /// The device they are for.
    pub(crate) fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The kernel `source` (WGSL, entry point `main`), completed by `constants`.
    pub(crate) fn get(
        &mut self,
        label: &'static str,
        source: &str,
        constants: &Constants,
    ) -> Result<Kernel, DeviceError> {
        let gpu = &self.gpu;
        let text = constants.clone().flag(SUBGROUPS, gpu.subgroups).complete(source);
        let mut compiled = gpu.compiled.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(kernel) = compiled.get(&text) {
            return Ok(kernel.clone());
        }
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(label),
            source: wgpu::ShaderSource::Wgsl(text.as_str().into()),
        });
        let bindings = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(label),
            entries: &entries(&text),
        });
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(label),
            bind_group_layouts: &[Some(&bindings)],
            immediate_size: 0,
        });
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(label),
            layout: Some(&layout),
            module: &module,
            entry_point: Some("main"),
            compilation_options: wgpu::PipelineCompilationOptions {
                zero_initialize_workgroup_memory: false,
                ..Default::default()
            },
            cache: None,
        });
        gpu.check()?;
        let kernel = Kernel { label, pipeline };
        compiled.insert(text, kernel.clone());
        Ok(kernel)
    }

    /// A kernel and its call at once.
    pub(crate) fn run(
        &mut self,
        label: &'static str,
        source: &str,
        constants: &Constants,
        groups: [usize; 3],
        bindings: &[&dyn Binding],
    ) -> Result<Call, DeviceError> {
        let kernel = self.get(label, source, constants)?;
        self.call(&kernel, groups, bindings)
    }

    /// A call of a kernel: `groups` workgroups along x, y, z; buffers in the order of their binding numbers.
    pub(crate) fn call(
        &self,
        kernel: &Kernel,
        groups: [usize; 3],
        bindings: &[&dyn Binding],
    ) -> Result<Call, DeviceError> {
        let (asked, max) = (groups.into_iter().max().unwrap_or(0), self.gpu.max_groups as usize);
        if asked > max {
            let (device, what) = (self.gpu.name().to_owned(), kernel.label.to_owned());
            return Err(DeviceError::Size { device, what, asked, max });
        }
        let entries: Vec<wgpu::BindGroupEntry> = bindings
            .iter()
            .enumerate()
            .map(|(i, b)| wgpu::BindGroupEntry { binding: i as u32, resource: b.raw().as_entire_binding() })
            .collect();
        let held = bindings.iter().map(|b| b.held().clone()).collect();
        let bindings = self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(kernel.label),
            layout: &kernel.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        self.gpu.check()?;
        Ok(Call { kernel: kernel.clone(), bindings, groups: groups.map(|g| g as u32), _held: held })
    }
}

/// The bindings that a shader declares. Left to itself, wgpu forgets those that are declared and not used.
fn entries(text: &str) -> Vec<wgpu::BindGroupLayoutEntry> {
    let declared = text.lines().filter_map(|line| {
        let (binding, rest) = line.trim().strip_prefix("@group(0) @binding(")?.split_once(')')?;
        Some((binding.parse().ok()?, rest.contains("var<storage, read>")))
    });
    declared
        .map(|(binding, read_only)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        })
        .collect()
}

/// What completes a shader: constants, and what its lines `#if NAME`, `#else`, `#endif` go by.
#[derive(Clone, Debug, Default)]
pub(crate) struct Constants {
    text: String,
    flags: Vec<&'static str>,
}

impl Constants {
    /// A number of things.
    pub(crate) fn count(mut self, name: &str, value: usize) -> Self {
        let value = u32::try_from(value).expect("sizes of a kernel fit into 32 bits");
        self.text += &format!("const {name}: u32 = {value}u;\n");
        self
    }

    /// A quantity.
    pub(crate) fn value(mut self, name: &str, value: f64) -> Self {
        self.text += &format!("const {name}: f32 = {:e}f;\n", value as f32);
        self
    }

    /// Includes the lines behind `#if name`.
    pub(crate) fn flag(mut self, name: &'static str, on: bool) -> Self {
        if on {
            self.flags.push(name);
        }
        self
    }

    fn complete(&self, source: &str) -> String {
        let mut out = self.text.clone();
        let mut included = None;
        for line in source.lines() {
            match line.trim().split_once(' ').unwrap_or((line.trim(), "")) {
                ("#if", name) => included = Some(self.flags.contains(&name)),
                ("#else", _) => included = included.map(|is| !is),
                ("#endif", _) => included = None,
                _ if included != Some(false) => {
                    out += line;
                    out.push('\n');
                }
                _ => {}
            }
        }
        out
    }
}

/// The flag of devices whose subgroups' threads see each other's values: every kernel has it there.
const SUBGROUPS: &str = "SUBGROUPS";

/// What a kernel begins with whose form depends on subgroups.
pub(crate) const PLACE: &str = include_str!("shaders/place.wgsl");

/// Workgroups for `n` threads of a grid of `size` each, folded into two dimensions: thread
/// `(wid.y * FOLD + wid.x) * size + lid.x`.
pub(crate) fn folded(n: usize, size: usize) -> [usize; 3] {
    let groups = n.div_ceil(size).max(1);
    [groups.min(FOLD), groups.div_ceil(FOLD), 1]
}

/// Workgroups along x of a folded grid.
pub(crate) const FOLD: usize = 32_768;

#[cfg(test)]
mod tests {
    use super::super::test_gpu;
    use super::*;

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
        let n = gpu.max_buffer_bytes as usize / 4 + 1;
        let e = gpu.zeros::<f32>("the cost volume", n).unwrap_err().to_string();
        assert!(e.contains("the cost volume") && e.contains("MB") && e.contains("--device cpu"), "{e}");
        gpu.check().unwrap();
    }

    #[test]
    fn too_many_workgroups_are_refused_before_they_are_tried() {
        let Some(gpu) = test_gpu() else { return };
        let (x, y) = (gpu.upload("x", &[1.0f32; 8]).unwrap(), gpu.zeros::<f32>("y", 8).unwrap());
        let constants = Constants::default().count("N", 8).count("FOLD", FOLD);
        let groups = [gpu.max_groups as usize + 1, 1, 1];
        let e = Kernels::new(&gpu).run("double", DOUBLE, &constants, groups, &[&x, &y]).unwrap_err().to_string();
        assert!(e.contains("double") && e.contains("--samples") && e.contains("--device cpu"), "{e}");
        gpu.check().unwrap();
    }

    #[test]
    fn a_faulty_kernel_is_an_error_and_a_lost_device_too() {
        let Some(gpu) = super::super::test_gpu_alone() else { return };
        let e = Kernels::new(&gpu).get("faulty", "fn main( {", &Constants::default()).unwrap_err().to_string();
        assert!(e.contains("report"), "{e}");
        let Some(gpu) = super::super::test_gpu_alone() else { return };
        let buffer = gpu.upload("x", &[1.0f32; 8]).unwrap();
        gpu.destroy();
        let e = gpu.read(&buffer, 8).unwrap_err();
        assert!(matches!(e, DeviceError::Lost { .. }), "{e:?}");
        assert!(gpu.check().is_err() && e.to_string().contains("--device cpu"), "{e}");
    }
}
