//! A USB camera's features: its own description of them, and the registers that it names.

use std::cell::{RefCell, RefMut};
use std::time::{Duration, Instant};

use viva_genapi::{GenApiError, NodeMap, RegisterIo};
use viva_u3v::{U3vDevice, UsbTransfer};

use crate::genicam::features::{FeatureError, Features};

/// Time between two looks at whether a command is done.
const POLL: Duration = Duration::from_millis(10);

/// The registers of a device.
struct Registers<T: UsbTransfer>(RefCell<U3vDevice<T>>);

impl<T: UsbTransfer> RegisterIo for Registers<T> {
    fn read(&self, addr: u64, len: usize) -> Result<Vec<u8>, GenApiError> {
        self.0.borrow_mut().read_mem(addr, len).map_err(|e| GenApiError::Io(Box::new(e)))
    }

    fn write(&self, addr: u64, data: &[u8]) -> Result<(), GenApiError> {
        self.0.borrow_mut().write_mem(addr, data).map_err(|e| GenApiError::Io(Box::new(e)))
    }
}

/// A device with its description.
pub(super) struct Nodes<T: UsbTransfer> {
    map: NodeMap,
    registers: Registers<T>,
}

impl<T: UsbTransfer> Nodes<T> {
    /// Returns the device with the features that `xml` describes; the error says what is wrong with that.
    pub(super) fn new(xml: &str, device: U3vDevice<T>) -> Result<Self, String> {
        let model = viva_genapi_xml::parse(xml).map_err(|e| e.to_string())?;
        let map = NodeMap::try_from_xml(model).map_err(|e| e.to_string())?;
        Ok(Self { map, registers: Registers(RefCell::new(device)) })
    }

    /// Returns the device itself.
    pub(super) fn device(&mut self) -> RefMut<'_, U3vDevice<T>> {
        self.registers.0.borrow_mut()
    }

    /// Returns the bytes of a frame by the camera's own word; 0 where it has none.
    pub(super) fn payload_size(&self) -> u64 {
        self.map.invalidate("PayloadSize");
        let bytes = self.map.get_integer("PayloadSize", &self.registers);
        bytes.ok().and_then(|b| u64::try_from(b).ok()).unwrap_or(0)
    }

    /// Waits until a command is done, or for as long as given: a camera need not say.
    pub(super) fn wait_until_done(&self, command: &str, longest: Duration) {
        let begun = Instant::now();
        while matches!(self.map.is_done(command, &self.registers), Ok(false)) && begun.elapsed() < longest {
            std::thread::sleep(POLL);
        }
    }
}

impl From<GenApiError> for FeatureError {
    fn from(e: GenApiError) -> Self {
        let no_access = matches!(e, GenApiError::Access { .. } | GenApiError::Unavailable(_));
        Self { no_access, text: e.to_string() }
    }
}

impl<T: UsbTransfer> Features for Nodes<T> {
    fn has(&self, name: &str) -> bool {
        // What one description has for several models is not in all of them.
        self.map.node(name).is_some() && self.map.is_implemented(name, &self.registers).unwrap_or(true)
    }

    fn entries(&mut self, name: &str) -> Result<Vec<String>, FeatureError> {
        Ok(self.map.enum_entries(name)?)
    }

    fn entry(&mut self, name: &str) -> Result<String, FeatureError> {
        self.map.invalidate(name);
        Ok(self.map.get_enum(name, &self.registers)?)
    }

    fn choose(&mut self, name: &str, entry: &str) -> Result<(), FeatureError> {
        Ok(self.map.set_enum(name, entry, &self.registers)?)
    }

    fn switch(&mut self, name: &str, on: bool) -> Result<(), FeatureError> {
        Ok(self.map.set_bool(name, on, &self.registers)?)
    }

    fn number(&mut self, name: &str) -> Result<f64, FeatureError> {
        self.map.invalidate(name);
        match self.map.get_float(name, &self.registers) {
            // Some count in whole numbers what others measure.
            Err(GenApiError::Type { .. }) => Ok(self.map.get_integer(name, &self.registers)? as f64),
            other => Ok(other?),
        }
    }

    fn set_number(&mut self, name: &str, value: f64) -> Result<(), FeatureError> {
        match self.map.set_float(name, value, &self.registers) {
            Err(GenApiError::Type { .. }) => self.set_integer(name, value.round() as i64),
            other => Ok(other?),
        }
    }

    fn set_integer(&mut self, name: &str, value: i64) -> Result<(), FeatureError> {
        Ok(self.map.set_integer(name, value, &self.registers)?)
    }

    fn run(&mut self, name: &str) -> Result<(), FeatureError> {
        Ok(self.map.exec_command(name, &self.registers)?)
    }
}
