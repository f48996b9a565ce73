//! A GigE Vision camera over the loopback interface: telegenic's emulator of a device answers the driver's commands and
//! streams what a display shows, late, noisy, with lost packets and lost frames.
#![cfg(feature = "gige-emulator")]

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nelu3d_capture::{Camera, CaptureError, CaptureSession, Display, GigeCamera, GigeSettings, Slide};
use nelu3d_scan::image::{Channels, Raw, RawData};
use telegenic::emulator::{DeviceConfig, GigeDevice, ResendRequest, mark_resent};

const SIZE: [usize; 2] = [160, 120];
const FRAME: Duration = Duration::from_millis(20);
/// Registers of the emulated device: acquisition under way, exposure time.
const ACQUISITION: u32 = 0x2008;
const EXPOSURE: u32 = 0x2014;
/// Bytes of IP and UDP around a packet's own.
const OVERHEAD: usize = 28;

/// What goes wrong between the device and the driver.
#[derive(Clone, Copy)]
struct Faults {
    /// From the display's word to the change in the picture.
    latency: Duration,
    /// Part of the packets that are lost.
    packets_lost: f64,
    /// Part of the frames of which nothing arrives.
    frames_lost: f64,
    /// Whether lost packets are sent again when asked for.
    resends: bool,
}

struct Room {
    device: GigeDevice,
    faults: Faults,
    clock: Instant,
    /// When which slide comes to be seen.
    changes: Vec<(Duration, Slide)>,
    random: u64,
    sent: Vec<(u64, Vec<Vec<u8>>)>,
}

/// The display, and the device with its threads.
struct Emulated {
    room: Arc<Mutex<Room>>,
    address: SocketAddr,
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

/// Code of a pixel under a slide.
fn code(slide: Slide, x: usize, y: usize) -> f64 {
    let surface = 200.0 * (1.0 - 0.4 * y as f64 / SIZE[1] as f64);
    let part = match slide {
        Slide::White => 1.0,
        Slide::Black => 0.0,
        Slide::Pattern(i) => 0.5 + 0.5 * (x as f64 / (5.0 + 3.0 * i as f64)).sin(),
    };
    8.0 + surface * part
}

impl Room {
    fn uniform(&mut self) -> f64 {
        self.random = self.random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.random >> 33) as f64 / (1u64 << 31) as f64
    }

    fn picture(&mut self) -> Vec<u8> {
        let now = self.clock.elapsed();
        let slide = self.changes.iter().rev().find(|c| c.0 <= now).map_or(Slide::White, |c| c.1);
        let mut codes = Vec::with_capacity(SIZE[0] * SIZE[1]);
        for y in 0..SIZE[1] {
            for x in 0..SIZE[0] {
                let noise = self.uniform() + self.uniform() + self.uniform() - 1.5;
                codes.push((code(slide, x, y) + 3.0 * noise).round() as u8);
            }
        }
        codes
    }
}

impl Emulated {
    fn new(faults: Faults) -> Self {
        let ip = Ipv4Addr::LOCALHOST;
        let config = DeviceConfig { width: SIZE[0] as u32, height: SIZE[1] as u32, ..DeviceConfig::default() };
        let mut device = GigeDevice::new(ip, &config);
        device.set_packet_resend(faults.resends);
        device.set_max_packet_size(Some(1500));
        let control = UdpSocket::bind((ip, 0)).unwrap();
        control.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
        let stream = UdpSocket::bind((ip, 0)).unwrap();
        let address = control.local_addr().unwrap();
        let (clock, changes) = (Instant::now(), vec![(Duration::ZERO, Slide::White)]);
        let room = Arc::new(Mutex::new(Room { device, faults, clock, changes, random: 7, sent: Vec::new() }));
        let stop = Arc::new(AtomicBool::new(false));
        let answers = {
            let (room, stop, stream) = (room.clone(), stop.clone(), stream.try_clone().unwrap());
            std::thread::spawn(move || {
                let mut buffer = [0; 0xffff];
                while !stop.load(Ordering::Relaxed) {
                    if let Ok((n, from)) = control.recv_from(&mut buffer) {
                        answer(&room, &control, &stream, &buffer[..n], from);
                    }
                }
            })
        };
        let frames = {
            let (room, stop) = (room.clone(), stop.clone());
            std::thread::spawn(move || stream_frames(&room, &stream, &stop))
        };
        Self { room, address, stop, threads: vec![answers, frames] }
    }

    fn connect(&self, settings: &GigeSettings) -> Result<GigeCamera, CaptureError> {
        let clock = self.room.lock().unwrap().clock;
        let camera = GigeCamera::connect_at(self.address, settings, Arc::new(AtomicBool::new(false)))?;
        Ok(camera.with_clock(clock))
    }
}

impl Drop for Emulated {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.threads.drain(..).for_each(|t| t.join().unwrap());
    }
}

fn answer(room: &Mutex<Room>, control: &UdpSocket, stream: &UdpSocket, datagram: &[u8], from: SocketAddr) {
    let mut room = room.lock().unwrap();
    let reaction = room.device.handle_datagram(datagram, from);
    if let Some(reply) = reaction.reply {
        control.send_to(&reply, from).unwrap();
    }
    let Some(to) = room.device.stream_dest() else { return };
    if let Some(size) = reaction.fire_test {
        let _ = stream.send_to(&vec![0; usize::from(size).saturating_sub(OVERHEAD)], to);
    }
    if let Some(ResendRequest { frame_id, first_packet, last_packet }) = reaction.resend
        && let Some((_, packets)) = room.sent.iter().find(|s| s.0 == frame_id)
    {
        for packet in packets.iter().take(last_packet as usize + 1).skip(first_packet as usize) {
            let mut packet = packet.clone();
            mark_resent(&mut packet);
            stream.send_to(&packet, to).unwrap();
        }
    }
}

fn stream_frames(room: &Mutex<Room>, stream: &UdpSocket, stop: &AtomicBool) {
    let mut id = 0;
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(FRAME);
        let mut room = room.lock().unwrap();
        let Some(to) = room.device.stream_dest() else { continue };
        if room.device.read_reg(ACQUISITION) != 1 {
            continue;
        }
        id = if id >= 0xffff { 1 } else { id + 1 };
        let picture = room.picture();
        let packets = room.device.frame_packets(id, &picture);
        room.sent.push((id, packets.clone()));
        let old = room.sent.len().saturating_sub(4);
        room.sent.drain(..old);
        if room.uniform() < room.faults.frames_lost {
            continue;
        }
        for packet in packets {
            if room.uniform() >= room.faults.packets_lost {
                stream.send_to(&packet, to).unwrap();
            }
        }
    }
}

/// The display of the room.
struct Shown(Arc<Mutex<Room>>);

impl Display for Shown {
    fn show(&mut self, slide: Slide) -> Result<Duration, CaptureError> {
        let mut room = self.0.lock().unwrap();
        let now = room.clock.elapsed();
        let seen = now + room.faults.latency;
        room.changes.push((seen, slide));
        Ok(now)
    }
}

/// Mean difference between a picture and a slide, codes.
fn difference(raw: &Raw, slide: Slide) -> f64 {
    let RawData::U8(codes) = &raw.data else { panic!("8 bits") };
    let expected = (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| code(slide, x, y)));
    codes.iter().zip(expected).map(|(c, e)| (f64::from(*c) - e).abs()).sum::<f64>() / codes.len() as f64
}

#[test]
fn every_image_shows_what_was_asked_whatever_the_network_does() {
    for (latency, packets_lost, frames_lost, resends) in
        [(0, 0.0, 0.0, false), (50, 0.01, 0.02, true), (110, 0.01, 0.05, false)]
    {
        let latency = Duration::from_millis(latency);
        let emulated = Emulated::new(Faults { latency, packets_lost, frames_lost, resends });
        let settings = GigeSettings { exposure_us: Some(8000.0), gain: Some(2.0) };
        let mut camera = emulated.connect(&settings).unwrap();
        assert_eq!((camera.channels(), camera.saturation()), (Channels::Mono, 255.0));
        let exposure = f32::from_bits(emulated.room.lock().unwrap().device.read_reg(EXPOSURE));
        assert_eq!(exposure, 8000.0);
        let mut display = Shown(emulated.room.clone());
        {
            let mut session = CaptureSession::start(&mut display, &mut camera).unwrap();
            let found = session.timing();
            assert!((found.frame_secs - FRAME.as_secs_f64()).abs() < 0.01, "{found:?}");
            assert!(found.latency_max_secs > latency.as_secs_f64(), "{found:?}");
            for _ in 0..3 {
                let images = session.take(8).unwrap();
                let taken = [(Slide::White, &images.white), (Slide::Black, &images.black)];
                let patterns = images.patterns.iter().enumerate().map(|(i, f)| (Slide::Pattern(i), f));
                for (slide, frame) in taken.into_iter().chain(patterns) {
                    assert_eq!([frame.raw.width, frame.raw.height], SIZE);
                    let off = difference(&frame.raw, slide);
                    assert!(off < 2.0, "{slide:?} is off by {off} codes at a latency of {latency:?}");
                }
            }
        }
        drop(camera);
        let room = emulated.room.lock().unwrap();
        assert!(room.device.read_reg(ACQUISITION) == 0 && room.device.stream_dest().is_none(), "it still streams");
    }
}

#[test]
fn what_a_camera_cannot_do_is_said() {
    let faults = Faults { latency: Duration::ZERO, packets_lost: 1.0, frames_lost: 0.0, resends: false };
    let emulated = Emulated::new(faults);
    // One program has a camera at a time.
    let first = emulated.connect(&GigeSettings::default()).unwrap();
    drop(first);
    let stop = Arc::new(AtomicBool::new(true));
    let mut camera = GigeCamera::connect_at(emulated.address, &GigeSettings::default(), stop).unwrap();
    assert!(matches!(camera.next_frame(), Err(CaptureError::Stopped)));
    // Nobody at home.
    let nobody = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap().local_addr().unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let e = GigeCamera::connect_at(nobody, &GigeSettings::default(), stop).unwrap_err().to_string();
    assert!(e.contains("127.0.0.1") && e.contains("power"), "{e}");
}
