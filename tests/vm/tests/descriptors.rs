//! What every simulated device says of itself is well formed, and a host at the other end of a socket is answered. Needs no guest.

#![cfg(unix)]

use std::io::{Read, Write};
use std::os::unix::net::UnixStream;

use isobath_vm::profiles::d435::D435;
use isobath_vm::profiles::generic::Generic;
use isobath_vm::profiles::headset::Headset;
use isobath_vm::profiles::kinect::Kinect;
use isobath_vm::profiles::orbbec::gemini_336;
use isobath_vm::usb::{Descriptors, Device, Plugged, Speed};
use isobath_vm::uvc::Transport;

/// The pieces of a configuration descriptor; panics where their lengths don't add up.
fn pieces(d: &[u8]) -> Vec<&[u8]> {
    let (mut rest, mut found) = (d, Vec::new());
    while !rest.is_empty() {
        let (piece, after) = rest.split_at(usize::from(rest[0]));
        assert!(piece.len() >= 2, "a descriptor without a type");
        found.push(piece);
        rest = after;
    }
    found
}

fn well_formed(descriptors: &Descriptors) {
    let d = &descriptors.configuration;
    let all = pieces(d);
    assert_eq!(usize::from(u16::from_le_bytes([d[2], d[3]])), d.len(), "wTotalLength");
    let interfaces: Vec<&[u8]> = all.iter().copied().filter(|p| p[1] == 4).collect();
    let numbers: std::collections::BTreeSet<u8> = interfaces.iter().map(|p| p[2]).collect();
    assert!(numbers.iter().copied().eq(0..d[4]), "bNumInterfaces");
    // Endpoints follow their interface, as many as it says.
    let (mut expected, mut addresses) = (0, Vec::new());
    for piece in &all {
        match piece[1] {
            4 => {
                assert_eq!(expected, 0, "bNumEndpoints");
                expected = piece[4];
            }
            5 => {
                expected -= 1;
                addresses.push(piece[2]);
            }
            _ => {}
        }
    }
    assert_eq!(expected, 0);
    addresses.sort_unstable();
    addresses.dedup();
    assert_eq!(addresses.len(), all.iter().filter(|p| p[1] == 5).count(), "an endpoint's address is there once");
    // Class-specific headers say how much follows them.
    for (at, header) in all.iter().enumerate().filter(|(_, p)| p[1] == 0x24 && p[2] == 1) {
        let is_control = header[3..5] == [0x10, 0x01] && header.len() == 13;
        let field = if is_control { 5 } else { 4 };
        let said = usize::from(u16::from_le_bytes([header[field], header[field + 1]]));
        let follows: usize = all[at..].iter().take_while(|p| p[1] == 0x24).map(|p| p.len()).sum();
        assert_eq!(said, follows, "wTotalLength of {header:?}");
    }
    assert_eq!(descriptors.identity.device().len(), 18);
}

#[test]
fn every_profile_describes_itself_well() {
    for speed in [Speed::High, Speed::Super] {
        for transport in
            [Transport::BulkWhole, Transport::Bulk { payload: 4096 }, Transport::Isochronous { packets: 2 }]
        {
            well_formed(&Generic::new("g", speed, transport, &[(640, 480), (32, 24)]).descriptors());
        }
        well_formed(&D435::new("d", speed).descriptors());
        well_formed(&gemini_336("o", speed).0.descriptors());
    }
    for speed in [Speed::High, Speed::Super] {
        well_formed(&Headset::new("h", (1, 2), [0xff, 1, 2], speed).descriptors());
    }
    well_formed(&Kinect::new("k").descriptors());
}

/// A request as a host sends it: to read `length` bytes by a control transfer.
fn get(sequence: u32, setup: [u8; 6], length: u16) -> Vec<u8> {
    let words = [1, sequence, 0, 1, 0, 0, u32::from(length), 0, u32::MAX, 0];
    let [low, high] = length.to_le_bytes();
    let [a, b, c, d, e, f] = setup;
    words.iter().flat_map(|w| w.to_be_bytes()).chain([a, b, c, d, e, f, low, high]).collect()
}

#[test]
fn a_host_is_answered_until_the_cable_is_pulled() {
    let (mut host, theirs) = UnixStream::pair().unwrap();
    let device = Generic::new("socket", Speed::High, Transport::BulkWhole, &[(32, 24)]);
    let expected = device.descriptors().configuration;
    let plugged = Plugged::serve(device, theirs).unwrap();
    host.write_all(&get(5, [0x80, 6, 0, 2, 0, 0], 4096)).unwrap();
    let mut header = [0; 48];
    host.read_exact(&mut header).unwrap();
    assert_eq!(header[..8], [0, 0, 0, 3, 0, 0, 0, 5]);
    let mut answer = vec![0; expected.len()];
    host.read_exact(&mut answer).unwrap();
    assert_eq!(answer, expected);
    assert!(plugged.is_plugged());
    let device = plugged.unplug().unwrap();
    assert_eq!(device.descriptors().configuration, expected);
    assert_eq!(host.read(&mut header).unwrap(), 0, "the link is closed");
}
