//! A fake USB3 Vision device: it answers commands of GenCP on one pair of endpoints, and streams what a scene shows on
//! another, as the controls in its registers ask for; some frames are lost or damaged on their way.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use viva_u3v::{U3vDevice, U3vError, UsbTransfer};

use super::registers::*;
use crate::scene::{FRAME, SIZE, Scene};

const COMMAND_OUT: u8 = 0x01;
const COMMAND_IN: u8 = 0x81;
const STREAM_IN: u8 = 0x82;

// Statuses of GenCP.
const SUCCESS: u16 = 0;
const INVALID_PARAMETER: u16 = 0x8002;
const INVALID_ADDRESS: u16 = 0x8003;
const WRITE_PROTECT: u16 = 0x8004;
const ACCESS_DENIED: u16 = 0x8006;

/// What is wrong with a device.
#[derive(Clone, Copy, Default)]
pub(crate) struct Faults {
    /// Part of the frames of which nothing is sent.
    pub(crate) lost: f64,
    /// Part of the frames that are damaged, each in one of five ways.
    pub(crate) damaged: f64,
    /// Automatic exposure cannot be switched off.
    pub(crate) automatic: bool,
    /// Longest exposure time, microseconds: longer ones become this one; 0: any.
    pub(crate) longest_exposure: f64,
}

struct Device {
    memory: Memory,
    scene: Arc<Mutex<Scene>>,
    faults: Faults,
    plugged: bool,
    acquires: bool,
    acknowledges: VecDeque<Vec<u8>>,
    /// What is sent on the stream, each part ended by a short packet.
    parts: VecDeque<Vec<u8>>,
    frame: u64,
    due: Instant,
}

/// The device, as one sees it that is plugged in.
pub(crate) struct FakeCamera(Mutex<Device>);

impl FakeCamera {
    pub(crate) fn new(scene: &Arc<Mutex<Scene>>, faults: Faults) -> Arc<Self> {
        Self::described(scene, faults, &description())
    }

    /// Returns a device with a description of its own.
    pub(crate) fn described(scene: &Arc<Mutex<Scene>>, faults: Faults, description: &str) -> Arc<Self> {
        Arc::new(Self(Mutex::new(Device {
            memory: Memory::new(description),
            scene: scene.clone(),
            faults,
            plugged: true,
            acquires: false,
            acknowledges: VecDeque::new(),
            parts: VecDeque::new(),
            frame: 0,
            due: Instant::now(),
        })))
    }

    pub(crate) fn open(self: &Arc<Self>) -> U3vDevice<Self> {
        U3vDevice::open(self.clone(), COMMAND_IN, COMMAND_OUT, Some(STREAM_IN), None).unwrap()
    }

    pub(crate) fn unplug(&self) {
        self.0.lock().unwrap().plugged = false;
    }

    /// Leaves it as a program does that was killed: streaming, and locked.
    pub(crate) fn leave_streaming(&self) {
        let mut device = self.0.lock().unwrap();
        device.memory.set(LOCKED, 1);
        device.memory.set(SIRM_CONTROL, 1);
        device.acquires = true;
    }

    /// Returns whether anything of streaming is left on.
    pub(crate) fn streams(&self) -> bool {
        let device = self.0.lock().unwrap();
        device.acquires || device.memory.get(SIRM_CONTROL) != 0 || device.memory.get(LOCKED) != 0
    }

    pub(crate) fn register(&self, at: usize) -> u32 {
        self.0.lock().unwrap().memory.get(at)
    }

    pub(crate) fn float_register(&self, at: usize) -> f64 {
        self.0.lock().unwrap().memory.float(at)
    }
}

impl UsbTransfer for FakeCamera {
    fn bulk_write(&self, endpoint: u8, data: &[u8], _: Duration) -> Result<usize, U3vError> {
        assert_eq!(endpoint, COMMAND_OUT);
        let mut device = self.0.lock().unwrap();
        if !device.plugged {
            return Err(U3vError::Disconnected);
        }
        device.command(data);
        Ok(data.len())
    }

    fn bulk_read(&self, endpoint: u8, buffer: &mut [u8], timeout: Duration) -> Result<usize, U3vError> {
        let begun = Instant::now();
        loop {
            let mut device = self.0.lock().unwrap();
            if !device.plugged {
                return Err(U3vError::Disconnected);
            }
            let sent = match endpoint {
                COMMAND_IN => device.acknowledges.pop_front(),
                STREAM_IN => device.next_transfer(buffer.len()),
                other => panic!("endpoint {other:#x} is not there"),
            };
            drop(device);
            if let Some(sent) = sent {
                buffer[..sent.len()].copy_from_slice(&sent);
                return Ok(sent.len());
            }
            if begun.elapsed() >= timeout {
                return Err(U3vError::Timeout);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

impl Device {
    /// Executes a command, and leaves the acknowledge to be read.
    fn command(&mut self, packet: &[u8]) {
        let short = |at: usize| u16::from_le_bytes(packet[at..at + 2].try_into().unwrap());
        let address = usize::try_from(u64::from_le_bytes(packet[12..20].try_into().unwrap())).unwrap();
        let (flags, command, length, id) = (short(4), short(6), short(8), short(10));
        assert_eq!(&packet[..4], b"U3VC");
        assert_eq!(flags, 1 << 14, "an acknowledge is asked for");
        assert_eq!(packet.len(), 12 + usize::from(length));
        assert!(packet.len() <= MAX_COMMAND as usize && id != 0);
        let (status, data) = match command {
            0x0800 => self.read(address, usize::from(short(22))),
            0x0802 => (self.write(address, &packet[20..]), Vec::new()),
            other => panic!("command {other:#x} is none of GenCP"),
        };
        let mut acknowledge = b"U3VC".to_vec();
        for field in [status, command + 1, data.len() as u16, id] {
            acknowledge.extend(field.to_le_bytes());
        }
        acknowledge.extend(data);
        self.acknowledges.push_back(acknowledge);
    }

    fn read(&self, at: usize, length: usize) -> (u16, Vec<u8>) {
        if length + 12 > MAX_ACKNOWLEDGE as usize {
            return (INVALID_PARAMETER, Vec::new());
        }
        match self.memory.0.get(at..at + length) {
            Some(data) => (SUCCESS, data.to_vec()),
            None => (INVALID_ADDRESS, Vec::new()),
        }
    }

    fn write(&mut self, at: usize, data: &[u8]) -> u16 {
        if at < FEATURES && at != SIRM_CONTROL && !SIRM_TRANSFERS.contains(&at) {
            return WRITE_PROTECT;
        }
        let value = || u32::from_le_bytes(data.try_into().unwrap());
        match at {
            PIXEL_FORMAT if self.acquires || self.memory.get(LOCKED) != 0 => return ACCESS_DENIED,
            PIXEL_FORMAT => self.memory.set_format(value()),
            START => {
                assert_eq!(self.memory.get(LOCKED), 1, "what must not change is locked first");
                (self.acquires, self.due) = (true, Instant::now() + FRAME);
            }
            STOP => {
                self.acquires = false;
                self.parts.clear();
            }
            EXPOSURE_AUTO if self.faults.automatic => {}
            EXPOSURE => {
                let wanted = f64::from_le_bytes(data.try_into().unwrap());
                let longest = self.faults.longest_exposure;
                let taken = if longest > 0.0 { wanted.min(longest) } else { wanted };
                self.memory.put(EXPOSURE, &taken.to_le_bytes());
            }
            _ => self.memory.put(at, data),
        }
        SUCCESS
    }

    /// Returns what a transfer of at most `length` bytes carries now.
    fn next_transfer(&mut self, length: usize) -> Option<Vec<u8>> {
        if self.parts.is_empty() && self.acquires && self.memory.get(SIRM_CONTROL) == 1 && Instant::now() >= self.due {
            self.send_frame();
            self.due = (self.due + FRAME).max(Instant::now());
        }
        let mut part = self.parts.pop_front()?;
        if part.len() > length {
            self.parts.push_front(part.split_off(length));
        }
        Some(part)
    }

    fn send_frame(&mut self) {
        self.frame += 1;
        let format = self.memory.get(PIXEL_FORMAT);
        let (codes, lost, damaged) = {
            let mut scene = self.scene.lock().unwrap();
            let codes = scene.codes();
            (codes, scene.uniform() < self.faults.lost, scene.uniform() < self.faults.damaged)
        };
        let mut payload: Vec<u8> = match format {
            MONO8 => codes.iter().map(|c| c.round() as u8).collect(),
            _ => codes.iter().flat_map(|c| ((16.0 * c).round() as u16).to_le_bytes()).collect(),
        };
        let whole = payload.len();
        let leader = leader(self.frame, format);
        // Ends in a short packet whatever the transfers are.
        let cut = whole / 2 + 7;
        if lost {
            return;
        }
        if !damaged {
            self.parts.extend([leader, payload, trailer(self.frame, 0, whole)]);
            return;
        }
        match self.frame % 5 {
            // It says itself that the picture is short.
            0 => {
                payload.truncate(cut);
                self.parts.extend([leader, payload, trailer(self.frame, 0, cut)]);
            }
            // It says that it sent more.
            1 => {
                payload.truncate(cut);
                self.parts.extend([leader, payload, trailer(self.frame, 0, whole)]);
            }
            // The end is missing.
            2 => {
                payload.truncate(cut);
                self.parts.extend([leader, payload]);
            }
            // All bytes, but the device says that it had lost some of them.
            3 => {
                payload[cut..].fill(0);
                self.parts.extend([leader, payload, trailer(self.frame, 0xa101, whole)]);
            }
            // The beginning is missing.
            _ => self.parts.extend([payload, trailer(self.frame, 0, whole)]),
        }
    }
}

fn leader(frame: u64, format: u32) -> Vec<u8> {
    let mut bytes = b"U3VL".to_vec();
    bytes.extend([0u16, 52].map(u16::to_le_bytes).concat());
    bytes.extend(frame.to_le_bytes());
    // An image.
    bytes.extend([0u16, 1].map(u16::to_le_bytes).concat());
    bytes.extend((frame * FRAME.as_nanos() as u64).to_le_bytes());
    bytes.extend([format, SIZE[0] as u32, SIZE[1] as u32, 0, 0].map(u32::to_le_bytes).concat());
    bytes.extend([0; 4]);
    assert_eq!(bytes.len(), 52);
    bytes
}

fn trailer(frame: u64, status: u16, valid: usize) -> Vec<u8> {
    let mut bytes = b"U3VT".to_vec();
    bytes.extend([0u16, 32].map(u16::to_le_bytes).concat());
    bytes.extend(frame.to_le_bytes());
    bytes.extend([status, 0].map(u16::to_le_bytes).concat());
    bytes.extend((valid as u64).to_le_bytes());
    bytes.extend((SIZE[1] as u32).to_le_bytes());
    assert_eq!(bytes.len(), 32);
    bytes
}
