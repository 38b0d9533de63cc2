//! From isochronous packets to whole frames of Kinect v1's depth, or to the knowledge that one is broken.
//!
//! ```text
//! 0 'R' 'B'   2 pad   3 flag   4 ?   5 sequence   6 ? ?   8 u32 time stamp   12 up to 1748 bytes of the frame
//! ```
//!
//! The flag is 0x71 in a frame's first packet, 0x75 in its last, 0x72 between. A frame of 422,400 bytes is 242 packets, the last with 1132 bytes; the
//! sequence counts packets in eight bits. Isochronous packets are never sent again, so what is lost is lost.
//!
//! libfreenect fills the gap of up to five lost packets with what was there before, and hands the frame out. Here a frame is whole, each of its
//! packets there once, in order and of full length, or it is not given at all. Every frame of which a packet came is counted once, whole or broken;
//! a frame that the program joined in its middle is neither. A duplicate of the last packet is dropped and counted, and harms nothing.
//!
//! Memory: the caller's frame, and 40 bytes. Cost: a copy of each packet.

use super::FRAME_BYTES;

/// Bytes of a packet's header.
pub const HEADER: usize = 12;
/// Bytes of a frame in each packet but the last.
pub const DATA: usize = 1748;
/// Bytes of the longest packet.
pub const PACKET: usize = HEADER + DATA;
/// Packets of a frame.
pub const PACKETS: usize = FRAME_BYTES.div_ceil(DATA);
/// Bytes in the last one.
const LAST: usize = FRAME_BYTES - (PACKETS - 1) * DATA;

/// From here on a step of the sequence is one back, not a loss: up to seven packets.
const LATE: u8 = 0xf8;

const FIRST_FLAG: u8 = 0x71;
const MIDDLE_FLAG: u8 = 0x72;
const LAST_FLAG: u8 = 0x75;

/// What came of a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[must_use]
pub enum Event {
    /// Nothing yet.
    Wait,
    /// The frame is whole: use it before the next packet.
    Frame {
        /// The device's time stamp of its last packet.
        time: u32,
    },
    /// A frame can't become whole any more: it is counted as broken.
    Broken,
}

/// What came of all packets so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Frames given.
    pub whole: u64,
    /// Frames begun, or met in their middle, and not given.
    pub broken: u64,
    /// Packets missing, by their sequence; a loss of 249 to 256 in a row looks like something else, and breaks its frame all the
    /// same.
    pub lost: u64,
    /// Packets that came twice.
    pub duplicates: u64,
    /// Packets that came up to seven places late: their frame was given up when they were missed.
    pub late: u64,
    /// Packets that are none: cut off in their header, or without their magic.
    pub strange: u64,
}

/// Where in a frame the stream is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// No frame begun since the stream was joined: what comes may be the rest of one.
    Joining,
    /// Between frames.
    Between,
    /// So many packets of a frame are there.
    In(usize),
    /// In a frame that is given up.
    Skipping,
}

/// Puts packets together.
#[derive(Debug, Clone)]
pub struct Assembler {
    state: State,
    /// Of the next packet.
    sequence: Option<u8>,
    counts: Counts,
}

impl Default for Assembler {
    fn default() -> Self {
        Self::new()
    }
}

impl Assembler {
    /// Before the first packet.
    #[must_use]
    pub const fn new() -> Self {
        let counts = Counts { whole: 0, broken: 0, lost: 0, duplicates: 0, late: 0, strange: 0 };
        Self { state: State::Joining, sequence: None, counts }
    }

    /// What came of the packets so far.
    #[must_use]
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    /// The stream begins anew (after a stop, or when the bus lost track): a frame begun is broken.
    pub fn restart(&mut self) {
        if matches!(self.state, State::In(_)) {
            self.counts.broken += 1;
        }
        (self.state, self.sequence) = (State::Joining, None);
    }

    /// The bus says that a packet did not come, or came damaged.
    pub fn missing(&mut self) -> Event {
        self.give_up()
    }

    /// Takes a packet; an empty one is the bus saying that there was nothing to send. `frame` must be the same from call to call, of
    /// [`FRAME_BYTES`].
    pub fn packet(&mut self, packet: &[u8], frame: &mut [u8]) -> Event {
        if packet.is_empty() {
            return Event::Wait;
        }
        let header = packet.split_first_chunk::<HEADER>();
        let Some(([b'R', b'B', _, flag, _, sequence, _, _, t0, t1, t2, t3], data)) = header else {
            self.counts.strange += 1;
            return self.give_up();
        };
        let time = u32::from_le_bytes([*t0, *t1, *t2, *t3]);
        let lost = self.sequence.map_or(0, |want| sequence.wrapping_sub(want));
        if lost == u8::MAX {
            // One behind: the packet before, again.
            self.counts.duplicates += 1;
            return Event::Wait;
        }
        if lost >= LATE {
            self.counts.late += 1;
            return self.give_up();
        }
        self.sequence = Some(sequence.wrapping_add(1));
        self.counts.lost += u64::from(lost);
        let mut event = if lost > 0 { self.give_up() } else { Event::Wait };
        match (self.state, *flag) {
            (_, FIRST_FLAG) => {
                if matches!(self.state, State::In(_)) {
                    event = self.give_up();
                }
                if !self.place(0, data, frame) {
                    // A frame that begins with a packet of the wrong length.
                    self.state = State::In(0);
                    event = self.give_up();
                }
            }
            (State::In(at), MIDDLE_FLAG) if at < PACKETS - 1 => {
                if !self.place(at, data, frame) {
                    event = self.give_up();
                }
            }
            (State::In(at), LAST_FLAG) if at == PACKETS - 1 => {
                if self.place(at, data, frame) {
                    self.state = State::Between;
                    self.counts.whole += 1;
                    return Event::Frame { time };
                }
                event = self.give_up();
                self.state = State::Between;
            }
            // The rest of a frame already given up, or joined in its middle.
            (State::Skipping | State::Joining, MIDDLE_FLAG) => {}
            (State::Skipping | State::Joining, LAST_FLAG) => self.state = State::Between,
            // The middle or the end of a frame whose beginning was lost, or that is too long or too short.
            (State::Between | State::In(_), MIDDLE_FLAG | LAST_FLAG) => {
                self.state = State::In(0);
                event = self.give_up();
                if *flag == LAST_FLAG {
                    self.state = State::Between;
                }
            }
            // No flag of this stream.
            _ => {
                self.counts.strange += 1;
                let broken = self.give_up();
                event = if broken == Event::Broken { broken } else { event };
            }
        }
        event
    }

    /// Copies a packet's data to its place, if it is as long as it should be.
    fn place(&mut self, at: usize, data: &[u8], frame: &mut [u8]) -> bool {
        let length = if at == PACKETS - 1 { LAST } else { DATA };
        let place = frame.get_mut(at * DATA..).and_then(|rest| rest.get_mut(..length));
        let Some(place) = place.filter(|place| place.len() == data.len()) else { return false };
        place.copy_from_slice(data);
        self.state = State::In(at + 1);
        true
    }

    /// The frame begun can't become whole.
    fn give_up(&mut self) -> Event {
        if matches!(self.state, State::In(_)) {
            self.state = State::Skipping;
            self.counts.broken += 1;
            return Event::Broken;
        }
        Event::Wait
    }
}

/// Writes packet `index` (0 to [`PACKETS`] - 1) of a frame, as a camera would; how many bytes it is, 0 beyond the frame.
pub fn write_packet(frame: &[u8], index: usize, sequence: u8, time: u32, out: &mut [u8; PACKET]) -> usize {
    let start = index.saturating_mul(DATA);
    let end = start.saturating_add(DATA).min(frame.len());
    let Some(data) = frame.get(start..end).filter(|data| !data.is_empty()) else { return 0 };
    let flag = match index {
        0 => FIRST_FLAG,
        _ if end == frame.len() => LAST_FLAG,
        _ => MIDDLE_FLAG,
    };
    let [t0, t1, t2, t3] = time.to_le_bytes();
    let (header, place) = out.split_at_mut(HEADER);
    header.copy_from_slice(&[b'R', b'B', 0, flag, 0, sequence, 0, 0, t0, t1, t2, t3]);
    if let Some(place) = place.get_mut(..data.len()) {
        place.copy_from_slice(data);
    }
    HEADER + data.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec;
    use std::vec::Vec;

    fn picture(number: usize) -> Vec<u8> {
        (0..FRAME_BYTES).map(|i| (i * 31 + number * 7 + i / 999) as u8).collect()
    }

    /// The packets of frames, each with the number of its frame.
    fn stream(frames: usize) -> Vec<(usize, Vec<u8>)> {
        let mut sequence = 200_u8;
        let mut all = Vec::new();
        for number in 0..frames {
            let frame = picture(number);
            for index in 0..PACKETS {
                let mut packet = [0; PACKET];
                let used = write_packet(&frame, index, sequence, number as u32, &mut packet);
                all.push((number, packet[..used].to_vec()));
                sequence = sequence.wrapping_add(1);
            }
        }
        all
    }

    #[test]
    fn packets_are_as_documented() {
        assert_eq!((PACKETS, LAST, PACKET), (242, 1132, 1760));
        let all = stream(1);
        assert_eq!((all[0].1[3], all[1].1[3], all[241].1[3]), (0x71, 0x72, 0x75));
        assert_eq!(all[241].1.len(), 12 + 1132);
        assert_eq!(write_packet(&picture(0), PACKETS, 0, 0, &mut [0; PACKET]), 0);
    }

    #[test]
    fn whole_frames_come_back() {
        let (mut assembler, mut frame) = (Assembler::new(), vec![0; FRAME_BYTES]);
        let mut given = 0;
        for (number, packet) in stream(3) {
            if let Event::Frame { time } = assembler.packet(&packet, &mut frame) {
                assert_eq!((time as usize, number), (given, given));
                assert!(frame == picture(given));
                given += 1;
            }
        }
        assert_eq!(assembler.counts(), Counts { whole: 3, ..Counts::default() });
    }

    #[test]
    fn a_stream_joined_in_its_middle_breaks_nothing() {
        let (mut assembler, mut frame) = (Assembler::new(), vec![0; FRAME_BYTES]);
        for (_, packet) in &stream(2)[100..] {
            let _ = assembler.packet(packet, &mut frame);
        }
        assert_eq!(assembler.counts(), Counts { whole: 1, ..Counts::default() });
        assert!(frame == picture(1));
    }

    #[test]
    fn a_small_frame_buffer_gives_no_frame() {
        let (mut assembler, mut frame) = (Assembler::new(), vec![0; FRAME_BYTES - 1]);
        for (_, packet) in stream(2) {
            assert!(!matches!(assembler.packet(&packet, &mut frame), Event::Frame { .. }));
        }
        assert_eq!(assembler.counts(), Counts { broken: 2, ..Counts::default() });
    }

    /// One thing that can happen to a packet on its way.
    #[derive(Debug, Clone, Copy)]
    enum Fault {
        Drop,
        Twice,
        Swap,
        Cut(usize),
        Garbage,
        BusError,
    }

    fn fault() -> impl Strategy<Value = Fault> {
        prop_oneof![
            Just(Fault::Drop),
            Just(Fault::Twice),
            Just(Fault::Swap),
            (0_usize..PACKET).prop_map(Fault::Cut),
            Just(Fault::Garbage),
            Just(Fault::BusError),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn every_frame_given_was_whole_and_every_one_is_counted(
            faults in prop::collection::vec((0_usize..5 * PACKETS, fault()), 0..8),
        ) {
            let frames = 5;
            let mut all: Vec<(usize, Vec<u8>, bool)> = stream(frames).into_iter().map(|(n, p)| (n, p, false)).collect();
            // Later ones first, so that places stay.
            let mut faults = faults;
            faults.sort_by_key(|(at, _)| core::cmp::Reverse(*at));
            let mut touched = vec![false; frames];
            for (at, fault) in faults {
                let at = at.min(all.len() - 1);
                let number = all[at].0;
                touched[number] |= !matches!(fault, Fault::Twice);
                match fault {
                    Fault::Drop => drop(all.remove(at)),
                    Fault::Twice => all.insert(at, all[at].clone()),
                    Fault::Swap => {
                        let other = (at + 1).min(all.len() - 1);
                        touched[all[other].0] |= at != other;
                        all.swap(at, other);
                    }
                    Fault::Cut(length) => {
                        let length = length.min(all[at].1.len());
                        all[at].1.truncate(length);
                    }
                    Fault::Garbage => all[at].1.fill(0x5a),
                    Fault::BusError => all[at].2 = true,
                }
            }
            let (mut assembler, mut frame) = (Assembler::new(), vec![0; FRAME_BYTES]);
            let mut given = vec![0; frames];
            for (_, packet, bus_error) in &all {
                let event = if *bus_error { assembler.missing() } else { assembler.packet(packet, &mut frame) };
                if let Event::Frame { time } = event {
                    prop_assert!(frame == picture(time as usize), "frame {time} is not whole");
                    given[time as usize] += 1;
                }
            }
            assembler.restart();
            let counts = assembler.counts();
            prop_assert_eq!(counts.whole, given.iter().sum::<u64>());
            prop_assert!(given.iter().all(|n| *n <= 1));
            for (number, given) in given.iter().enumerate() {
                // What nothing happened to is given, unless it was the neighbour of a fault that took its first packets with it.
                let near = touched[number]
                    || (number > 0 && touched[number - 1])
                    || touched.get(number + 1).copied().unwrap_or(false);
                prop_assert!(*given == 1 || near, "frame {number}");
            }
            // Each is counted once; a frame all of whose first packets are lost may hide in its neighbour.
            let seen = counts.whole + counts.broken;
            prop_assert!(seen <= frames as u64, "{counts:?}");
            if touched.iter().all(|t| !t) {
                prop_assert_eq!(counts.whole, frames as u64);
            }
        }

        #[test]
        fn any_bytes_are_survived(packets in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..40), 0..60)) {
            let (mut assembler, mut frame) = (Assembler::new(), vec![0; FRAME_BYTES]);
            for mut packet in packets {
                if let [m0, m1, _, flag, ..] = &mut packet[..] {
                    (*m0, *m1) = (b'R', b'B');
                    *flag = 0x70 | *flag & 7;
                }
                let whole = matches!(assembler.packet(&packet, &mut frame), Event::Frame { .. });
                prop_assert!(!whole);
            }
        }
    }
}
