//! The memory of a fake USB3 Vision device, as GenCP and USB3 Vision lay it out, and its description of its features.

use std::fmt::Write as _;

use crate::scene::SIZE;

pub(crate) const SBRM: usize = 0x1000;
pub(crate) const SIRM: usize = 0x2000;
/// Bit 0: the stream is enabled.
pub(crate) const SIRM_CONTROL: usize = SIRM + 0x04;
const SIRM_PAYLOAD: usize = SIRM + 0x08;
/// What the host says of its transfers: the only other registers below the features that may be written.
pub(crate) const SIRM_TRANSFERS: std::ops::Range<usize> = SIRM + 0x18..SIRM + 0x30;
const MANIFEST: usize = 0x3000;

/// Where the features begin.
pub(crate) const FEATURES: usize = 0x4000;
pub(crate) const PIXEL_FORMAT: usize = FEATURES;
pub(crate) const EXPOSURE_AUTO: usize = FEATURES + 0x04;
pub(crate) const GAIN_AUTO: usize = FEATURES + 0x08;
pub(crate) const EXPOSURE: usize = FEATURES + 0x10;
pub(crate) const GAIN: usize = FEATURES + 0x18;
pub(crate) const LOCKED: usize = FEATURES + 0x20;
pub(crate) const START: usize = FEATURES + 0x24;
pub(crate) const STOP: usize = FEATURES + 0x28;
pub(crate) const MODE: usize = FEATURES + 0x2c;
const PAYLOAD: usize = FEATURES + 0x30;
const WIDTH: usize = FEATURES + 0x34;
const HEIGHT: usize = FEATURES + 0x38;
const XML: usize = 0x8000;
/// Bytes of the memory.
const LENGTH: usize = 0x10000;

pub(crate) const MONO8: u32 = 0x0108_0001;
pub(crate) const MONO12: u32 = 0x0110_0005;
/// Largest command and acknowledge, bytes.
pub(crate) const MAX_COMMAND: u32 = 128;
pub(crate) const MAX_ACKNOWLEDGE: u32 = 512;
pub(crate) const SERIAL: &str = "U3V-7";

/// A device's memory.
pub(crate) struct Memory(pub(crate) Vec<u8>);

impl Memory {
    /// Returns the memory of a device that was just switched on: 8 bits, automatic exposure and gain.
    pub(crate) fn new(description: &str) -> Self {
        let mut memory = Self(vec![0; LENGTH]);
        memory.put(0x44, b"Retina");
        memory.put(0x144, SERIAL.as_bytes());
        // There is an SBRM.
        memory.put(0x1c4, &(1u64 << 9).to_le_bytes());
        memory.put(0x1cc, &50u32.to_le_bytes());
        memory.put(0x1d0, &(MANIFEST as u64).to_le_bytes());
        memory.put(0x1d8, &(SBRM as u64).to_le_bytes());
        // There is a SIRM; one stream.
        memory.put(SBRM + 0x04, &1u64.to_le_bytes());
        memory.put(SBRM + 0x14, &MAX_COMMAND.to_le_bytes());
        memory.put(SBRM + 0x18, &MAX_ACKNOWLEDGE.to_le_bytes());
        memory.put(SBRM + 0x1c, &1u32.to_le_bytes());
        memory.put(SBRM + 0x20, &(SIRM as u64).to_le_bytes());
        memory.put(SBRM + 0x28, &0x30u32.to_le_bytes());
        // USB 3.
        memory.put(SBRM + 0x40, &8u32.to_le_bytes());
        // Transfers of whole kilobytes.
        memory.put(SIRM, &(10u32 << 24).to_le_bytes());
        memory.put(SIRM + 0x10, &52u32.to_le_bytes());
        memory.put(SIRM + 0x14, &32u32.to_le_bytes());
        memory.put(MANIFEST, &1u64.to_le_bytes());
        memory.put(MANIFEST + 16, &(XML as u64).to_le_bytes());
        memory.put(MANIFEST + 24, &(description.len() as u64).to_le_bytes());
        memory.put(XML, description.as_bytes());
        memory.set(WIDTH, SIZE[0] as u32);
        memory.set(HEIGHT, SIZE[1] as u32);
        memory.set(EXPOSURE_AUTO, 2);
        memory.set(GAIN_AUTO, 2);
        memory.put(EXPOSURE, &123.0f64.to_le_bytes());
        memory.set_format(MONO8);
        memory
    }

    pub(crate) fn put(&mut self, at: usize, bytes: &[u8]) {
        self.0[at..at + bytes.len()].copy_from_slice(bytes);
    }

    pub(crate) fn set(&mut self, at: usize, value: u32) {
        self.put(at, &value.to_le_bytes());
    }

    pub(crate) fn get(&self, at: usize) -> u32 {
        u32::from_le_bytes(self.0[at..at + 4].try_into().unwrap())
    }

    pub(crate) fn float(&self, at: usize) -> f64 {
        f64::from_le_bytes(self.0[at..at + 8].try_into().unwrap())
    }

    pub(crate) fn set_format(&mut self, format: u32) {
        self.set(PIXEL_FORMAT, format);
        let bytes = SIZE[0] * SIZE[1] * if format == MONO8 { 1 } else { 2 };
        self.set(PAYLOAD, bytes as u32);
        self.set(SIRM_PAYLOAD, bytes as u32);
    }
}

/// Returns the description of the features.
pub(crate) fn description() -> String {
    let mut xml = String::from(
        "<?xml version=\"1.0\"?><RegisterDescription ModelName=\"Retina\" VendorName=\"nelu3d\" \
         StandardNameSpace=\"USB\" SchemaMajorVersion=\"1\" SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" \
         MajorVersion=\"1\" MinorVersion=\"0\" SubMinorVersion=\"0\">\n",
    );
    let mut register = |name: &str, kind: &str, at: usize, length: usize, access: &str| {
        let sign = if kind == "IntReg" { "<Sign>Unsigned</Sign>" } else { "" };
        writeln!(
            xml,
            "<{kind} Name=\"{name}Register\"><Address>{at}</Address><Length>{length}</Length><AccessMode>{access}\
             </AccessMode><pPort>Device</pPort>{sign}<Endianess>LittleEndian</Endianess></{kind}>"
        )
        .unwrap();
    };
    for (name, at, access) in [
        ("Width", WIDTH, "RO"),
        ("Height", HEIGHT, "RO"),
        ("PayloadSize", PAYLOAD, "RO"),
        ("TLParamsLocked", LOCKED, "RW"),
        ("PixelFormat", PIXEL_FORMAT, "RW"),
        ("AcquisitionMode", MODE, "RW"),
        ("AcquisitionStart", START, "WO"),
        ("AcquisitionStop", STOP, "WO"),
        ("ExposureAuto", EXPOSURE_AUTO, "RW"),
        ("GainAuto", GAIN_AUTO, "RW"),
    ] {
        register(name, "IntReg", at, 4, access);
    }
    register("ExposureTime", "FloatReg", EXPOSURE, 8, "RW");
    register("Gain", "FloatReg", GAIN, 8, "RW");
    for name in ["Width", "Height", "PayloadSize", "TLParamsLocked"] {
        writeln!(xml, "<Integer Name=\"{name}\"><pValue>{name}Register</pValue></Integer>").unwrap();
    }
    for name in ["ExposureTime", "Gain"] {
        writeln!(xml, "<Float Name=\"{name}\"><pValue>{name}Register</pValue></Float>").unwrap();
    }
    for name in ["AcquisitionStart", "AcquisitionStop"] {
        let value = "<CommandValue>1</CommandValue>";
        writeln!(xml, "<Command Name=\"{name}\"><pValue>{name}Register</pValue>{value}</Command>").unwrap();
    }
    let automatic = [("Off", 0), ("Continuous", 2)];
    let formats = [("Mono8", MONO8), ("Mono12", MONO12)];
    let modes = [("SingleFrame", 0), ("Continuous", 2)];
    for (name, entries) in
        [("PixelFormat", formats), ("AcquisitionMode", modes), ("ExposureAuto", automatic), ("GainAuto", automatic)]
    {
        let lock = if name == "PixelFormat" { "<pIsLocked>TLParamsLocked</pIsLocked>" } else { "" };
        write!(xml, "<Enumeration Name=\"{name}\">{lock}").unwrap();
        for (entry, value) in entries {
            write!(xml, "<EnumEntry Name=\"{entry}\"><Value>{value}</Value></EnumEntry>").unwrap();
        }
        writeln!(xml, "<pValue>{name}Register</pValue></Enumeration>").unwrap();
    }
    xml + "<Port Name=\"Device\"/></RegisterDescription>\n"
}
