//! A GigE Vision camera over the loopback interface: telegenic's emulator of a device answers the driver's commands and
//! streams what a display shows, late, noisy, with lost packets and lost frames.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use nelu3d_capture::{Camera, CameraSettings, CaptureError, GigeCamera};
use nelu3d_scan::image::Channels;
use telegenic::emulator::{DeviceConfig, GigeDevice, ResendRequest, mark_resent};

use super::scene::{FRAME, SIZE, Scene, assert_every_image_shows_what_was_asked};

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
    scene: Arc<Mutex<Scene>>,
    sent: Vec<(u64, Vec<Vec<u8>>)>,
}

/// The display, and the device with its threads.
struct Emulated {
    room: Arc<Mutex<Room>>,
    scene: Arc<Mutex<Scene>>,
    address: SocketAddr,
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Room {
    fn uniform(&self) -> f64 {
        self.scene.lock().unwrap().uniform()
    }

    fn picture(&self) -> Vec<u8> {
        self.scene.lock().unwrap().codes().into_iter().map(|c| c.round() as u8).collect()
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
        let scene = Scene::new(faults.latency);
        let room = Arc::new(Mutex::new(Room { device, faults, scene: scene.clone(), sent: Vec::new() }));
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
        Self { room, scene, address, stop, threads: vec![answers, frames] }
    }

    fn connect(&self, settings: &CameraSettings) -> Result<GigeCamera, CaptureError> {
        let clock = self.scene.lock().unwrap().clock();
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

#[test]
fn every_image_shows_what_was_asked_whatever_the_network_does() {
    for (latency, packets_lost, frames_lost, resends) in
        [(0, 0.0, 0.0, false), (50, 0.01, 0.02, true), (110, 0.01, 0.05, false)]
    {
        let latency = Duration::from_millis(latency);
        let emulated = Emulated::new(Faults { latency, packets_lost, frames_lost, resends });
        let settings = CameraSettings { exposure_us: Some(8000.0), gain: Some(2.0) };
        let mut camera = emulated.connect(&settings).unwrap();
        assert_eq!((camera.channels(), camera.saturation()), (Channels::Mono, 255.0));
        let exposure = f32::from_bits(emulated.room.lock().unwrap().device.read_reg(EXPOSURE));
        assert_eq!(exposure, 8000.0);
        assert_every_image_shows_what_was_asked(&emulated.scene, &mut camera);
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
    let first = emulated.connect(&CameraSettings::default()).unwrap();
    drop(first);
    let stop = Arc::new(AtomicBool::new(true));
    let mut camera = GigeCamera::connect_at(emulated.address, &CameraSettings::default(), stop).unwrap();
    assert!(matches!(camera.next_frame(), Err(CaptureError::Stopped)));
    // Nobody at home.
    let nobody = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap().local_addr().unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let e = GigeCamera::connect_at(nobody, &CameraSettings::default(), stop).unwrap_err().to_string();
    assert!(e.contains("127.0.0.1") && e.contains("power"), "{e}");
}
