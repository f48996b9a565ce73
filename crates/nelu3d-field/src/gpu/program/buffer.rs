//! Values on the device.

use super::super::adapter::Gpu;
use super::memory::Held;
use super::wait::PATIENCE;
use crate::device::DeviceError;
use bytemuck::Pod;
use std::marker::PhantomData;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use wgpu::BufferUsages;

/// Values on the device.
#[derive(Clone, Debug)]
pub struct Buffer<T = f32> {
    raw: wgpu::Buffer,
    len: usize,
    held: Arc<Held>,
    kind: PhantomData<T>,
}

impl<T: Pod> Buffer<T> {
    /// Returns the number of values.
    pub(crate) fn len(&self) -> usize {
        self.len
    }
}

/// A buffer of any type, as a kernel is given it.
pub trait Binding {
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

impl Gpu {
    /// Returns the bytes of all buffers that there are now.
    pub fn memory(&self) -> u64 {
        self.memory.now.load(Ordering::Relaxed)
    }

    /// Returns the most bytes of buffers that there were at a time.
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

    /// Makes a buffer of zeros; `what` names them in errors.
    #[doc(hidden)]
    pub fn zeros<T: Pod>(&self, what: &str, len: usize) -> Result<Buffer<T>, DeviceError> {
        // New buffers are zero.
        self.allocate(what, len)
    }

    /// Makes a buffer of given values; `what` names it in errors.
    #[doc(hidden)]
    pub fn upload<T: Pod>(&self, what: &str, values: &[T]) -> Result<Buffer<T>, DeviceError> {
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
    #[doc(hidden)]
    pub fn read<T: Pod>(&self, buffer: &Buffer<T>, len: usize) -> Result<Vec<T>, DeviceError> {
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
}
