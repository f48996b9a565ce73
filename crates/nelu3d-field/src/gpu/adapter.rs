//! Finding a GPU, and opening it.

use super::program::{BufferMemory, Compiled};
use crate::device::{Choice, DeviceError, Found};
use std::collections::HashMap;
use std::fmt;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use wgpu::{Adapter, Backends, DeviceType, Features, Instance, InstanceDescriptor, InstanceFlags};

/// Storage buffers that the largest kernel binds.
const STORAGE_BUFFERS: u32 = 12;
/// Threads of a workgroup.
const WORKGROUP: u32 = 256;
/// Bytes that a workgroup shares.
const WORKGROUP_BYTES: u32 = 16 << 10;

/// An opened GPU.
pub struct Gpu {
    name: String,
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    /// Whether it adds f32 atomically.
    pub(super) f32_atomics: bool,
    /// Whether threads of a subgroup see each other's values.
    pub(super) subgroups: bool,
    /// Whether a workgroup's memory is faster than the rest.
    pub(super) tiles: bool,
    pub(super) max_buffer_bytes: u64,
    /// The most workgroups along one axis of a call.
    pub(super) max_groups: u32,
    pub(super) memory: Arc<BufferMemory>,
    pub(super) compiled: Compiled,
    failure: Arc<Mutex<Option<DeviceError>>>,
}

impl fmt::Debug for Gpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Gpu({})", self.name)
    }
}

/// Adapters in the order of their numbers: real ones first.
fn adapters() -> Vec<Adapter> {
    // Validation layers are for developers of drivers.
    let instance = Instance::new(InstanceDescriptor {
        backends: Backends::VULKAN | Backends::METAL | Backends::DX12,
        flags: InstanceFlags::empty().with_env(),
        ..InstanceDescriptor::new_without_display_handle()
    });
    let mut all = pollster::block_on(instance.enumerate_adapters(Backends::all()));
    let rank = |a: &Adapter| match a.get_info().device_type {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    };
    all.sort_by_key(rank);
    all
}

/// Returns why an adapter cannot be used.
fn unusable(adapter: &Adapter) -> Option<String> {
    let limits = adapter.limits();
    let less = |what: &str, has: u64, needed: u64| (has < needed).then(|| format!("{what}: {has}, needed {needed}"));
    less("storage buffers of a kernel", limits.max_storage_buffers_per_shader_stage.into(), STORAGE_BUFFERS.into())
        .or(less("threads of a workgroup", limits.max_compute_invocations_per_workgroup.into(), WORKGROUP.into()))
        .or(less("bytes a workgroup shares", limits.max_compute_workgroup_storage_size.into(), WORKGROUP_BYTES.into()))
}

fn found(number: usize, adapter: &Adapter) -> Found {
    let info = adapter.get_info();
    let features = adapter.features();
    let kind = match info.device_type {
        DeviceType::DiscreteGpu => "discrete",
        DeviceType::IntegratedGpu => "integrated",
        DeviceType::VirtualGpu => "virtual",
        DeviceType::Cpu => "software",
        DeviceType::Other => "unknown",
    };
    let limits = adapter.limits();
    let unusable = unusable(adapter);
    Found {
        device: Choice::GpuAt(number),
        name: info.name.clone(),
        kind,
        backend: info.backend.to_string(),
        driver: [info.driver, info.driver_info].join(" ").trim().to_owned(),
        max_buffer_bytes: max_buffer_bytes(&limits),
        features: [(Features::SHADER_FLOAT32_ATOMIC, "f32-atomics"), (Features::SUBGROUP, "subgroups")]
            .into_iter()
            .filter(|(f, _)| features.contains(*f))
            .map(|(_, name)| name)
            .collect(),
        // A software driver does on the CPU what the CPU forms do faster.
        automatic: unusable.is_none() && info.device_type != DeviceType::Cpu,
        unusable,
    }
}

fn max_buffer_bytes(limits: &wgpu::Limits) -> u64 {
    limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
}

/// Returns all GPUs; see [`crate::device::list`].
pub fn list() -> Vec<Found> {
    adapters().iter().enumerate().map(|(i, a)| found(i, a)).collect()
}

impl Gpu {
    /// Opens a GPU; the same choice gives the same one, or the same answer that there is none, unless it was lost.
    pub(crate) fn open(choice: Choice) -> Result<Arc<Self>, DeviceError> {
        type Opened = HashMap<Choice, Result<Arc<Gpu>, DeviceError>>;
        static OPENED: OnceLock<Mutex<Opened>> = OnceLock::new();
        let mut opened = OPENED.get_or_init(Mutex::default).lock().unwrap_or_else(PoisonError::into_inner);
        match opened.get(&choice) {
            Some(Ok(gpu)) if gpu.check().is_err() => {}
            Some(answer) => return answer.clone(),
            None => {}
        }
        let answer = Self::open_anew(choice);
        opened.insert(choice, answer.clone());
        answer
    }

    /// Opens a device of one's own, to break in a test.
    ///
    /// # Errors
    ///
    /// There is no such device.
    #[doc(hidden)]
    pub fn open_anew(choice: Choice) -> Result<Arc<Self>, DeviceError> {
        let adapters = adapters();
        let found: Vec<Found> = adapters.iter().enumerate().map(|(i, a)| found(i, a)).collect();
        let none = |reason: String| DeviceError::None { choice, reason };
        let number = match choice {
            Choice::GpuAt(n) => n,
            _ => found
                .iter()
                .position(|f| if choice == Choice::Auto { f.automatic } else { f.unusable.is_none() })
                .ok_or_else(|| none("no GPU that could be used was found".into()))?,
        };
        let Some(there) = found.get(number) else {
            return Err(none(match found.len() {
                0 => "no GPU was found".into(),
                n => format!("the last GPU here is gpu:{}", n - 1),
            }));
        };
        if let Some(reason) = &there.unusable {
            return Err(none(format!("{} cannot be used ({reason})", there.name)));
        }
        Ok(Arc::new(Self::new(&adapters[number], there).map_err(none)?))
    }

    fn new(adapter: &Adapter, found: &Found) -> Result<Self, String> {
        let atomics = Features::SHADER_FLOAT32_ATOMIC;
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("nelu3d"),
            required_features: adapter.features() & (atomics | Features::SUBGROUP),
            required_limits: adapter.limits(),
            ..Default::default()
        }))
        .map_err(|e| e.to_string())?;
        let failure = Arc::new(Mutex::new(None));
        let name = found.name.clone();
        // The first failure is the cause of the others.
        let note = {
            let failure = failure.clone();
            move |e: DeviceError| {
                failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(e);
            }
        };
        let (lost, device_name) = (note.clone(), name.clone());
        device.set_device_lost_callback(move |reason, message| {
            let reason = format!("{reason:?} {message}").trim().to_lowercase();
            lost(DeviceError::Lost { device: device_name.clone(), reason });
        });
        let device_name = name.clone();
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| {
            let device = device_name.clone();
            note(match e {
                wgpu::Error::OutOfMemory { .. } => {
                    DeviceError::Memory { device, what: "a buffer".into(), needed: 0, max: 0 }
                }
                e => DeviceError::Failed { device, reason: e.to_string() },
            });
        }));
        let f32_atomics = device.features().contains(atomics);
        let subgroups = device.features().contains(Features::SUBGROUP);
        let device_limits = device.limits();
        let max_buffer_bytes = max_buffer_bytes(&device_limits);
        let tiles = adapter.get_info().device_type != DeviceType::Cpu;
        Ok(Self {
            name,
            device,
            queue,
            f32_atomics,
            subgroups,
            tiles,
            max_buffer_bytes,
            max_groups: device_limits.max_compute_workgroups_per_dimension,
            memory: Arc::default(),
            compiled: Default::default(),
            failure,
        })
    }

    /// Returns the name that the device gives itself.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns whether all has gone well so far.
    ///
    /// # Errors
    ///
    /// The first thing that did not.
    pub fn check(&self) -> Result<(), DeviceError> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).clone().map_or(Ok(()), Err)
    }

    /// Returns the largest buffer of a kernel, bytes.
    pub fn max_buffer_bytes(&self) -> u64 {
        self.max_buffer_bytes
    }

    /// Returns the most workgroups along one axis of a kernel's call.
    pub fn max_groups(&self) -> u32 {
        self.max_groups
    }

    pub(super) fn fail(&self, e: DeviceError) -> DeviceError {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(e).clone()
    }

    /// Pulls the plug, as a driver's reset would.
    #[doc(hidden)]
    pub fn destroy(&self) {
        self.device.destroy();
        let _ = self.device.poll(wgpu::PollType::Poll);
    }

    /// Opens a second handle that works the other way: without atomic additions, and with a workgroup's memory where
    /// the first does without.
    ///
    /// # Errors
    ///
    /// There is no such device.
    #[doc(hidden)]
    pub fn the_other_way(choice: Choice) -> Result<Arc<Self>, DeviceError> {
        let adapters = adapters();
        let Choice::GpuAt(n) = choice else { panic!("name a number") };
        let found = found(n, &adapters[n]);
        let mut gpu = Self::new(&adapters[n], &found).map_err(|reason| DeviceError::None { choice, reason })?;
        gpu.f32_atomics = false;
        gpu.subgroups = false;
        gpu.tiles = !gpu.tiles;
        Ok(Arc::new(gpu))
    }
}
