//! A capture against displays and cameras that do everything wrong: simulated ones, and emulated devices of the machine
//! vision standards.

#[cfg(feature = "gige-emulator")]
mod gige;
#[cfg(any(feature = "gige-emulator", feature = "usb3"))]
mod scene;
mod session;
#[cfg(feature = "usb3")]
mod usb3;
