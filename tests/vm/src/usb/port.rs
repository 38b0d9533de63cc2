//! Plugging a device into the kernel: Linux's virtual host controller (`vhci-hcd`), which speaks USB/IP over any stream socket.
//!
//! One end of a socket pair is handed to the controller by writing `PORT DESCRIPTOR DEVICE SPEED` to its `attach` file; a thread answers
//! at the other end. Shutting the socket down is pulling the cable. Needs root and the module `vhci-hcd`.

use std::fs;
use std::io::{self, Read, Write};
use std::net::Shutdown;
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::engine::Engine;
use super::{Device, Speed, usbip};

const CONTROLLER: &str = "/sys/devices/platform/vhci_hcd.0";

/// A test may change the device at any time; its thread looks at least this often.
const LOOK: Duration = Duration::from_millis(10);

/// A device that is plugged in, until this is dropped.
#[derive(Debug)]
pub struct Plugged<D: Device> {
    device: Arc<Mutex<D>>,
    socket: UnixStream,
    thread: Option<JoinHandle<()>>,
}

impl<D: Device> Plugged<D> {
    /// Plugs it into the first free port for its speed.
    ///
    /// # Errors
    /// The controller is not there, has no free port, or refuses.
    pub fn new(device: D) -> io::Result<Self> {
        let speed = device.descriptors().identity.speed;
        let (ours, theirs) = UnixStream::pair()?;
        let port = free_port(speed)?;
        let code = match speed {
            Speed::High => 3,
            Speed::Super => 5,
        };
        let plugged = Self::serve(device, ours)?;
        fs::write(format!("{CONTROLLER}/attach"), format!("{port} {} 65538 {code}", theirs.as_raw_fd()))?;
        Ok(plugged)
    }

    /// Answers a host at the other end of a socket, whoever that is.
    ///
    /// # Errors
    /// The socket can't be shared with a thread.
    pub fn serve(device: D, socket: UnixStream) -> io::Result<Self> {
        let device = Arc::new(Mutex::new(device));
        let (theirs, mut link) = (Arc::clone(&device), socket.try_clone()?);
        let thread = std::thread::spawn(move || {
            if let Err(error) = answer(&theirs, &mut link) {
                eprintln!("simulated device: {error}");
            }
            let _ = link.shutdown(Shutdown::Both);
        });
        Ok(Self { device, socket, thread: Some(thread) })
    }

    /// The device, to look at or to change while it runs.
    pub fn device(&self) -> MutexGuard<'_, D> {
        lock(&self.device)
    }

    /// Whether the cable is still in.
    #[must_use]
    pub fn is_plugged(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// Pulls the cable; the device can be plugged in again.
    ///
    /// # Errors
    /// Its thread ended in a panic.
    pub fn unplug(mut self) -> io::Result<D> {
        self.end();
        let device = Arc::clone(&self.device);
        drop(self);
        let device = Arc::try_unwrap(device).map_err(|_| io::Error::other("the device is still in use"))?;
        Ok(device.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    fn end(&mut self) {
        let _ = self.socket.shutdown(Shutdown::Both);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl<D: Device> Drop for Plugged<D> {
    fn drop(&mut self) {
        self.end();
    }
}

fn lock<D>(device: &Mutex<D>) -> MutexGuard<'_, D> {
    device.lock().unwrap_or_else(PoisonError::into_inner)
}

fn answer<D: Device>(device: &Mutex<D>, link: &mut UnixStream) -> io::Result<()> {
    let mut engine = Engine::new(lock(device).descriptors());
    let start = Instant::now();
    let (mut came, mut piece) = (Vec::new(), vec![0; 65536]);
    loop {
        let turn = engine.turn(&mut *lock(device), start.elapsed());
        if link.write_all(&turn.out).is_err() {
            return Ok(()); // unplugged
        }
        if turn.unplugged {
            return Ok(());
        }
        let wait = turn.wake.map_or(LOOK, |wake| wake.saturating_sub(start.elapsed())).min(LOOK);
        // A wait of zero would be one without end.
        link.set_read_timeout(Some(wait.max(Duration::from_micros(10))))?;
        match link.read(&mut piece) {
            Ok(0) => return Ok(()),
            Ok(n) => came.extend(&piece[..n]),
            Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {}
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) if error.kind() == io::ErrorKind::ConnectionReset => return Ok(()),
            Err(error) => return Err(error),
        }
        while let Some(request) = usbip::take(&mut came).map_err(io::Error::other)? {
            engine.request(&mut *lock(device), request, start.elapsed());
        }
    }
}

/// The number of a free port: lines of `status` are `hub port state ...`, state 4 is free.
fn free_port(speed: Speed) -> io::Result<u32> {
    let hub = match speed {
        Speed::High => "hs",
        Speed::Super => "ss",
    };
    let status = fs::read_to_string(format!("{CONTROLLER}/status"))
        .map_err(|e| io::Error::new(e.kind(), format!("{CONTROLLER}/status: {e}; is vhci-hcd loaded?")))?;
    let free = status.lines().find_map(|line| {
        let words: Vec<&str> = line.split_whitespace().collect();
        (words.first() == Some(&hub) && words.get(2) == Some(&"004")).then(|| words.get(1)?.parse().ok()).flatten()
    });
    free.ok_or_else(|| io::Error::other(format!("no free port for {hub} in:\n{status}")))
}
