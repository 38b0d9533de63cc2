//! Isochronous transfers over libusb: the one place of this crate with `unsafe`, as rusb has none of it.
//!
//! A fixed pool of transfers goes round: submitted, completed, read, submitted again. Each transfer is in one state, kept in an atomic:
//!
//! ```text
//! IDLE -- submit --> FLYING -- libusb's callback --> DONE -- packets read --> IDLE
//! ```
//!
//! Who may touch a transfer's memory follows from it: libusb and the kernel while it is FLYING, this module else. The rules, on which every
//! `SAFETY` below rests:
//!
//! 1. Transfers and buffers are made in [`IsoStream::new`] and freed in `drop`, and only when they are not FLYING. Should one not come back within the time
//!    that `drop` gives it, its memory is leaked: leaking is safe, freeing what the kernel may write to is not.
//! 2. The callback does one thing: FLYING becomes DONE, by the atomic behind `user_data`, which lives as long as the pool. It neither allocates, locks
//!    nor calls anything that can panic; it is wrapped in `catch_unwind` all the same, as unwinding into C is undefined.
//! 3. The device handle, and with it libusb's context, is kept by an [`Arc`] until the last transfer is back.
//! 4. Callbacks run in whoever handles libusb's events: [`IsoStream::next`], `drop`, or a synchronous transfer of another thread. DONE is stored with
//!    release and loaded with acquire, so what libusb wrote into the transfer is seen.
#![allow(unsafe_code, reason = "rusb has no isochronous transfers; this module's page says why each call is sound")]

use std::ffi::c_int;
use std::panic::catch_unwind;
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

use libusb1_sys as ffi;
use libusb1_sys::constants::{
    LIBUSB_ERROR_BUSY, LIBUSB_ERROR_NO_DEVICE, LIBUSB_ERROR_NO_MEM, LIBUSB_TRANSFER_COMPLETED,
    LIBUSB_TRANSFER_NO_DEVICE,
};
use rusb::{Context, DeviceHandle, UsbContext};

use crate::sys::{IsoLayout, UsbError};

const IDLE: u8 = 0;
const FLYING: u8 = 1;
const DONE: u8 = 2;
/// How long `drop` waits for cancelled transfers.
const DRAIN: Duration = Duration::from_secs(3);

/// One transfer of the pool.
struct Slot {
    transfer: NonNull<ffi::libusb_transfer>,
    /// What the transfer's `user_data` points to. Behind an `Arc`, which stays where it is and, other than a `Box`, claims no sole access when it moves.
    state: Arc<AtomicU8>,
    /// What the transfer's `buffer` points to: a `Vec` for the same reason. Never resized; while FLYING nobody here makes a reference to its bytes.
    buffer: Vec<u8>,
}

/// Transfers of one endpoint, going round.
pub(crate) struct IsoStream {
    handle: Arc<DeviceHandle<Context>>,
    slots: Vec<Slot>,
    /// The one that comes back next: transfers of an endpoint complete in the order of their submission.
    next: usize,
    layout: IsoLayout,
}

// SAFETY: the raw pointers are to memory that the pool owns alone (rules 1 and 3), and libusb may be called from any thread.
unsafe impl Send for IsoStream {}

extern "system" fn completed(transfer: *mut ffi::libusb_transfer) {
    let _ = catch_unwind(|| {
        // SAFETY: libusb calls this with a transfer of the pool, which lives (rule 1); so does the atomic behind its `user_data` (rule 2).
        // No reference to the transfer itself is made: the owner may hold one as soon as DONE is stored.
        let state = unsafe { (*transfer).user_data.cast::<AtomicU8>().as_ref() };
        if let Some(state) = state {
            state.store(DONE, Ordering::Release);
        }
    });
}

fn error(code: c_int) -> UsbError {
    match code {
        LIBUSB_ERROR_NO_DEVICE => UsbError::Gone,
        LIBUSB_ERROR_BUSY => UsbError::Busy,
        // What the kernel says when the bus has no room: usbfs's ENOSPC ends up here or as an error of input and output.
        LIBUSB_ERROR_NO_MEM => UsbError::NoBandwidth,
        ffi::constants::LIBUSB_ERROR_IO => UsbError::Io,
        ffi::constants::LIBUSB_ERROR_ACCESS => UsbError::Access,
        other => UsbError::Other(other),
    }
}

impl IsoStream {
    /// Makes the pool and submits all of it.
    pub(crate) fn new(handle: Arc<DeviceHandle<Context>>, layout: IsoLayout) -> Result<Self, UsbError> {
        let packets = c_int::try_from(layout.packets).ok().filter(|n| *n > 0 && layout.packet > 0);
        let packets = packets.ok_or(UsbError::Other(22))?;
        let bytes = layout.packets.checked_mul(layout.packet).ok_or(UsbError::Overflow)?;
        let length = c_int::try_from(bytes).map_err(|_| UsbError::Overflow)?;
        let mut stream = Self { handle, slots: Vec::with_capacity(layout.transfers), next: 0, layout };
        for _ in 0..layout.transfers {
            // SAFETY: a plain allocation with room for so many packet descriptors; null is refused.
            let transfer = NonNull::new(unsafe { ffi::libusb_alloc_transfer(packets) }).ok_or(UsbError::Other(-11))?;
            let mut slot = Slot { transfer, state: Arc::new(AtomicU8::new(IDLE)), buffer: vec![0; bytes] };
            let user_data = Arc::as_ptr(&slot.state).cast_mut().cast();
            // SAFETY: the transfer is ours and not submitted; the pointers given are to memory that lives as long as the pool (rules 1 to 3).
            // `libusb_set_iso_packet_lengths` writes the descriptors that were allocated with the transfer.
            unsafe {
                ffi::libusb_fill_iso_transfer(
                    transfer.as_ptr(),
                    stream.handle.as_raw(),
                    layout.endpoint,
                    slot.buffer.as_mut_ptr(),
                    length,
                    packets,
                    completed,
                    user_data,
                    0,
                );
                ffi::libusb_set_iso_packet_lengths(transfer.as_ptr(), layout.packet as _);
            }
            stream.slots.push(slot);
        }
        for index in 0..stream.slots.len() {
            // Those submitted before one that fails are cancelled and drained by `drop`.
            stream.submit(index)?;
        }
        Ok(stream)
    }

    fn submit(&mut self, index: usize) -> Result<(), UsbError> {
        let Some(slot) = self.slots.get_mut(index) else { return Err(UsbError::Other(0)) };
        debug_assert_eq!(slot.state.load(Ordering::Acquire), IDLE, "only what is here can be sent out");
        slot.state.store(FLYING, Ordering::Release);
        // SAFETY: the transfer is filled and was not FLYING; from here on until DONE nobody here touches it (rule 1).
        let code = unsafe { ffi::libusb_submit_transfer(slot.transfer.as_ptr()) };
        if code == 0 {
            return Ok(());
        }
        // It was not taken: no callback will come.
        slot.state.store(IDLE, Ordering::Release);
        Err(error(code))
    }

    /// Gives the packets of the next transfer that comes back, waiting for it until the time is up.
    pub(crate) fn next(&mut self, timeout: Duration, packet: &mut dyn FnMut(Option<&[u8]>)) -> Result<usize, UsbError> {
        let until = Instant::now() + timeout;
        let index = self.next;
        loop {
            match self.slots.get(index).map(|slot| slot.state.load(Ordering::Acquire)) {
                Some(DONE) => break,
                Some(FLYING) => {}
                // Could not be sent out again the last time.
                Some(_) => {
                    self.submit(index)?;
                    continue;
                }
                None => return Err(UsbError::Other(0)),
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(UsbError::Timeout);
            }
            match self.handle.context().handle_events(Some(left)) {
                Ok(()) | Err(rusb::Error::Interrupted) => {}
                Err(rusb::Error::NoDevice) => return Err(UsbError::Gone),
                Err(_) => return Err(UsbError::Io),
            }
        }
        let status = self.read(index, packet);
        if let Some(slot) = self.slots.get(index) {
            slot.state.store(IDLE, Ordering::Release);
        }
        self.next = (index + 1) % self.slots.len().max(1);
        if status == LIBUSB_TRANSFER_NO_DEVICE {
            return Err(UsbError::Gone);
        }
        self.submit(index)?;
        Ok(self.layout.packets)
    }

    /// Hands out the packets of a transfer that is DONE; its status.
    fn read(&self, index: usize, packet: &mut dyn FnMut(Option<&[u8]>)) -> c_int {
        let Some(slot) = self.slots.get(index) else { return LIBUSB_TRANSFER_NO_DEVICE };
        debug_assert_eq!(slot.state.load(Ordering::Acquire), DONE, "only what came back can be read");
        let transfer = slot.transfer.as_ptr();
        // SAFETY: DONE: libusb has finished with it, and what it wrote is seen (rule 4).
        let status = unsafe { (*transfer).status };
        for (i, bytes) in slot.buffer.chunks_exact(self.layout.packet).enumerate() {
            // SAFETY: the descriptors were allocated with the transfer, `layout.packets` of them, and `i` is below that: the buffer has as many
            // packets. The field has length 0 in Rust, so the address is computed from the transfer's own pointer, which covers the whole allocation.
            let descriptor = unsafe {
                (&raw const (*transfer).iso_packet_desc).cast::<ffi::libusb_iso_packet_descriptor>().add(i).read()
            };
            let came = usize::try_from(descriptor.actual_length).ok().and_then(|n| bytes.get(..n));
            let whole = status == LIBUSB_TRANSFER_COMPLETED && descriptor.status == LIBUSB_TRANSFER_COMPLETED;
            packet(came.filter(|_| whole));
        }
        status
    }
}

impl Drop for IsoStream {
    fn drop(&mut self) {
        for slot in &self.slots {
            if slot.state.load(Ordering::Acquire) == FLYING {
                // SAFETY: a submitted transfer; one that is just coming back is refused, which is as good.
                unsafe { ffi::libusb_cancel_transfer(slot.transfer.as_ptr()) };
            }
        }
        let until = Instant::now() + DRAIN;
        let flying = |slots: &[Slot]| slots.iter().any(|slot| slot.state.load(Ordering::Acquire) == FLYING);
        while flying(&self.slots) && Instant::now() < until {
            if self.handle.context().handle_events(Some(Duration::from_millis(50))).is_err() {
                std::thread::sleep(Duration::from_millis(5));
            }
        }
        for slot in self.slots.drain(..) {
            if slot.state.load(Ordering::Acquire) == FLYING {
                // Rule 1; its handle must live on as well (rule 3).
                std::mem::forget(Arc::clone(&self.handle));
                std::mem::forget(slot);
            } else {
                // SAFETY: not FLYING: libusb does not know it any more. Buffer and state follow when the slot is dropped.
                unsafe { ffi::libusb_free_transfer(slot.transfer.as_ptr()) };
            }
        }
    }
}
