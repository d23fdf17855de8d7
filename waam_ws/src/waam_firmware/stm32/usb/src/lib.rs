//! A USB serial port (CDC-ACM) on OTG_FS with a C interface (`port_usb.c`). Everything is called from the main loop, none
//! of it from interrupts. Clocks and pins are the board's business and must be ready before `waam_usb_start`.
#![no_std]

use core::cell::UnsafeCell;
use core::panic::PanicInfo;
use core::slice;

use synopsys_usb_otg::{UsbBus, UsbPeripheral};
use usb_device::bus::UsbBusAllocator;
use usb_device::prelude::*;
use usbd_serial::{SerialPort, USB_CLASS_CDC};

struct OtgFs;

// Safety: the register block of RM0090, chapter 34, used by nobody else.
unsafe impl UsbPeripheral for OtgFs {
    const REGISTERS: *const () = 0x5000_0000 as *const ();
    const HIGH_SPEED: bool = false;
    const FIFO_DEPTH_WORDS: usize = 320;
    const ENDPOINT_COUNT: usize = 4;

    fn enable() {}

    fn ahb_frequency_hz(&self) -> u32 {
        168_000_000
    }
}

type Bus = UsbBus<OtgFs>;

struct Port {
    device: UsbDevice<'static, Bus>,
    serial: SerialPort<'static, Bus, [u8; 512], [u8; 1024]>,
}

struct Global<T>(UnsafeCell<T>);

// Safety: the main loop is the only user.
unsafe impl<T> Sync for Global<T> {}

static MEMORY: Global<[u32; 512]> = Global(UnsafeCell::new([0; 512]));
static BUS: Global<Option<UsbBusAllocator<Bus>>> = Global(UnsafeCell::new(None));
static PORT: Global<Option<Port>> = Global(UnsafeCell::new(None));
static SERIAL_NUMBER: Global<[u8; 24]> = Global(UnsafeCell::new([b'0'; 24]));

/// The chip's 96-bit number in hexadecimal, so that the host can give the port a name that stays.
fn serial_number(id: &[u8; 12]) -> &'static str {
    const DIGITS: &[u8; 16] = b"0123456789ABCDEF";
    let text = unsafe { &mut *SERIAL_NUMBER.0.get() };
    for (pair, byte) in text.chunks_exact_mut(2).zip(id) {
        pair[0] = DIGITS[usize::from(byte >> 4)];
        pair[1] = DIGITS[usize::from(byte & 15)];
    }
    core::str::from_utf8(text).unwrap_or("0")
}

fn open(id: &[u8; 12]) -> Option<Port> {
    let bus = unsafe { &mut *BUS.0.get() };
    let bus = &*bus.insert(UsbBus::new(OtgFs, unsafe { &mut *MEMORY.0.get() }));
    let serial = SerialPort::new_with_store(bus, [0; 512], [0; 1024]);
    let names = StringDescriptors::default()
        .manufacturer("waam")
        .product("WAAM controller")
        .serial_number(serial_number(id));
    let device = UsbDeviceBuilder::new(bus, UsbVidPid(0x16c0, 0x27dd)) // shared by CDC-ACM devices
        .strings(&[names])
        .ok()?
        .device_class(USB_CLASS_CDC)
        .build();
    Some(Port { device, serial })
}

fn port() -> Option<&'static mut Port> {
    unsafe { &mut *PORT.0.get() }.as_mut()
}

/// `id`: the 12 bytes of the chip's number. Once only.
///
/// # Safety
/// `id` points to 12 readable bytes.
#[no_mangle]
pub unsafe extern "C" fn waam_usb_start(id: *const u8) {
    *PORT.0.get() = open(&*id.cast::<[u8; 12]>());
}

/// To be called often. True while a host has the port open.
#[no_mangle]
pub extern "C" fn waam_usb_poll() -> bool {
    port().is_some_and(|p| {
        p.device.poll(&mut [&mut p.serial]);
        p.device.state() == UsbDeviceState::Configured && p.serial.dtr()
    })
}

/// The number of bytes read; 0 when none are there. What is not read stays with the host.
///
/// # Safety
/// `bytes` points to `size` writable bytes.
#[no_mangle]
pub unsafe extern "C" fn waam_usb_read(bytes: *mut u8, size: usize) -> usize {
    port().map_or(0, |p| p.serial.read(slice::from_raw_parts_mut(bytes, size)).unwrap_or(0))
}

/// The number of bytes taken, which may be 0.
///
/// # Safety
/// `bytes` points to `size` readable bytes.
#[no_mangle]
pub unsafe extern "C" fn waam_usb_write(bytes: *const u8, size: usize) -> usize {
    port().map_or(0, |p| {
        let taken = p.serial.write(slice::from_raw_parts(bytes, size)).unwrap_or(0);
        let _ = p.serial.flush(); // WouldBlock: the rest goes with a later poll
        taken
    })
}

extern "C" {
    fn fault_handler() -> !;
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    unsafe { fault_handler() } // outputs off, then the watchdog
}

struct Interrupts;
critical_section::set_impl!(Interrupts);

// Safety: one core; interrupts are off in between and back as they were afterwards.
unsafe impl critical_section::Impl for Interrupts {
    unsafe fn acquire() -> u32 {
        let before: u32;
        core::arch::asm!("mrs {0}, PRIMASK", "cpsid i", out(reg) before);
        before
    }

    unsafe fn release(before: u32) {
        core::arch::asm!("msr PRIMASK, {0}", in(reg) before);
    }
}
