//! Kernels with their buffers.

use super::super::adapter::Gpu;
use super::buffer::Binding;
use super::constants::{Constants, SUBGROUPS};
use super::memory::Held;
use super::pipeline::Kernel;
use crate::device::DeviceError;
use std::sync::{Arc, PoisonError};

/// A kernel with its buffers and its number of workgroups.
#[derive(Clone, Debug)]
pub struct Call {
    pub(super) kernel: Kernel,
    pub(super) bindings: wgpu::BindGroup,
    pub(super) groups: [u32; 3],
    /// The buffers live as long as there is a call that uses them.
    _held: Arc<[Arc<Held>]>,
}

impl Call {
    /// Returns the kernel's name.
    pub(crate) fn label(&self) -> &'static str {
        self.kernel.label
    }
}

/// A device's kernels, compiled once for each set of constants.
#[derive(Debug)]
pub struct Kernels {
    gpu: Arc<Gpu>,
}

impl Kernels {
    /// Prepares to compile kernels for a device.
    pub fn new(gpu: &Arc<Gpu>) -> Self {
        Self { gpu: gpu.clone() }
    }

    /// Returns the device they are for.
    pub(crate) fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Compiles the kernel `source` (WGSL, entry point `main`), completed by `constants`.
    pub fn get(&mut self, label: &'static str, source: &str, constants: &Constants) -> Result<Kernel, DeviceError> {
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

    /// Compiles a kernel and makes its call.
    pub fn run(
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

    /// Makes a call of a kernel: `groups` workgroups along x, y, z; buffers in the order of their binding numbers.
    pub fn call(&self, kernel: &Kernel, groups: [usize; 3], bindings: &[&dyn Binding]) -> Result<Call, DeviceError> {
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

/// Returns the bindings that a shader declares. Left to itself, wgpu forgets those that are declared and not used.
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
