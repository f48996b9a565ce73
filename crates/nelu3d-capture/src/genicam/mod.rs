//! Cameras that describe themselves as the standard GenICam says, with no vendor's software: over the network (GigE
//! Vision) and over USB (USB3 Vision).
//!
//! A file imports only from above it here: `features`, `pixels`; `fix`; `frames`; `gige`, `usb3`.

mod features;
mod fix;
mod frames;
#[cfg(feature = "gige")]
mod gige;
mod pixels;
#[cfg(feature = "usb3")]
mod usb3;

pub use fix::CameraSettings;
#[cfg(feature = "gige")]
pub use gige::GigeCamera;
#[cfg(feature = "usb3")]
pub use usb3::Usb3Camera;
