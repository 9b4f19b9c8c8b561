//! Ack window: how many frames and bytes may be in flight to one client.
//!
//! The server renders and encodes for a view only while its window has room, so a slow link or a slow tab costs no
//! rendering and frames arrive without delay. Absent or false acknowledgements can only slow down their own view.

use std::collections::VecDeque;
use std::time::Duration;

/// Fewest frames in flight: one is transferred while the next one is rendered.
const MIN_FRAMES: u32 = 2;
/// Most frames in flight.
const MAX_FRAMES: u32 = 6;
/// Bytes in flight that are always allowed.
const MIN_BYTES: f64 = 256.0 * 1024.0;
/// Bytes in flight, in seconds of measured throughput.
const BYTES_SECS: f64 = 0.25;
/// Time over which the smallest round trip and the largest throughput are taken. The smallest, because the mean
/// contains the queue that the window bounds.
const MEMORY: Duration = Duration::from_secs(10);
/// Longer round trips come from a suspended tab and do not count.
const MAX_ROUND_TRIP: Duration = Duration::from_secs(10);
/// Decoding times kept for the median.
const DECODE_SAMPLES: usize = 32;
/// Round trips and throughputs kept.
const EXTREME_SAMPLES: usize = 64;

/// Why an acknowledgement was ignored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("ack.seq: frame {seq} is not among those in flight")]
pub struct AckError {
    /// The number acknowledged.
    pub seq: u32,
}

/// What follows from an acknowledgement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Acked {
    /// Frames it covers.
    pub frames: u32,
    /// Round trip of the newest of them, unless it exceeds 10 s.
    pub round_trip: Option<Duration>,
    /// Time beyond the smallest round trip.
    pub queue_delay: Option<Duration>,
}

#[derive(Clone, Copy, Debug)]
struct Sent {
    seq: u32,
    bytes: u64,
    at: Duration,
}

/// State of one view on one connection. All times are since the connection began.
#[derive(Clone, Debug)]
pub struct AckWindow {
    next_seq: u32,
    in_flight: VecDeque<Sent>,
    bytes_in_flight: u64,
    round_trips: Extremes,
    throughputs: Extremes,
    decode_times: VecDeque<Duration>,
    last_ack_at: Duration,
    last_sent_at: Option<Duration>,
}

impl Default for AckWindow {
    fn default() -> Self {
        Self::starting_at(1)
    }
}

impl AckWindow {
    /// A window whose first frame has this number.
    pub fn starting_at(seq: u32) -> Self {
        Self {
            next_seq: seq,
            in_flight: VecDeque::new(),
            bytes_in_flight: 0,
            round_trips: Extremes::default(),
            throughputs: Extremes::default(),
            decode_times: VecDeque::new(),
            last_ack_at: Duration::ZERO,
            last_sent_at: None,
        }
    }

    /// Frames that may be in flight at a frame rate: those of one round trip, and one more.
    pub fn frames(&self, frames_per_sec: f32) -> u32 {
        let decode = self.decode_median().unwrap_or_default();
        let Some(round_trip) = self.round_trip_min() else { return MIN_FRAMES };
        let frames = ((round_trip + decode).as_secs_f64() * f64::from(frames_per_sec.max(0.0))).ceil();
        (frames.min(f64::from(MAX_FRAMES)) as u32 + 1).clamp(MIN_FRAMES, MAX_FRAMES)
    }

    /// Bytes that may be in flight before another frame starts.
    pub fn bytes(&self) -> u64 {
        self.throughput().map_or(MIN_BYTES, |rate| (rate * BYTES_SECS).max(MIN_BYTES)) as u64
    }

    /// Whether another frame may start now.
    pub fn has_room(&self, frames_per_sec: f32) -> bool {
        (self.in_flight.len() as u32) < self.frames(frames_per_sec) && self.bytes_in_flight < self.bytes()
    }

    /// Earliest time of the next frame at a frame rate, leaving a tenth of a period for jitter.
    pub fn next_send_at(&self, frames_per_sec: f32) -> Duration {
        let period = Duration::try_from_secs_f32(0.9 / frames_per_sec.max(0.1)).unwrap_or_default();
        self.last_sent_at.map_or(Duration::ZERO, |at| at + period)
    }

    /// The number the next frame will have.
    pub fn next_seq(&self) -> u32 {
        self.next_seq
    }

    /// Records a frame given to the socket and returns its number. Callers check [`AckWindow::has_room`] first: frames
    /// beyond the largest window count as acknowledged, oldest first, so that memory is bounded.
    pub fn sent(&mut self, bytes: u64, now: Duration) -> u32 {
        let seq = self.next_seq;
        self.next_seq = seq.wrapping_add(1);
        if self.in_flight.len() >= MAX_FRAMES as usize
            && let Some(oldest) = self.in_flight.pop_front()
        {
            self.bytes_in_flight -= oldest.bytes;
        }
        self.in_flight.push_back(Sent { seq, bytes, at: now });
        self.bytes_in_flight += bytes;
        self.last_sent_at = Some(now);
        seq
    }

    /// The client acknowledges all frames up to `seq`. Numbers that are not in flight (repeated or invented) change
    /// nothing.
    pub fn acked(&mut self, seq: u32, decode: Duration, now: Duration) -> Result<Acked, AckError> {
        let position = self.in_flight.iter().position(|sent| sent.seq == seq).ok_or(AckError { seq })?;
        let began = self.in_flight[0].at.max(self.last_ack_at);
        let newest = self.in_flight[position];
        let bytes: u64 = self.in_flight.drain(..=position).map(|sent| sent.bytes).sum();
        self.bytes_in_flight -= bytes;
        self.last_ack_at = now;
        let secs = now.saturating_sub(began).as_secs_f64();
        if secs > 0.0 {
            self.throughputs.push(bytes as f64 / secs, now, f64::max);
        }
        if self.decode_times.len() == DECODE_SAMPLES {
            self.decode_times.pop_front();
        }
        self.decode_times.push_back(decode.min(MAX_ROUND_TRIP));
        let round_trip = Some(now.saturating_sub(newest.at)).filter(|time| *time <= MAX_ROUND_TRIP);
        if let Some(time) = round_trip {
            self.round_trips.push(time.as_secs_f64(), now, f64::min);
        }
        let queue_delay = round_trip.zip(self.round_trip_min()).map(|(time, least)| time.saturating_sub(least));
        Ok(Acked { frames: position as u32 + 1, round_trip, queue_delay })
    }

    /// Time for which an acknowledgement has been outstanding; zero if none is.
    pub fn silence(&self, now: Duration) -> Duration {
        let Some(oldest) = self.in_flight.front() else { return Duration::ZERO };
        now.saturating_sub(oldest.at.max(self.last_ack_at))
    }

    /// Frames in flight.
    pub fn in_flight(&self) -> u32 {
        self.in_flight.len() as u32
    }

    /// Smallest round trip of the last 10 s.
    pub fn round_trip_min(&self) -> Option<Duration> {
        self.round_trips.best(f64::min).and_then(|secs| Duration::try_from_secs_f64(secs).ok())
    }

    /// Largest measured throughput of the last 10 s, bytes per second.
    pub fn throughput(&self) -> Option<f64> {
        self.throughputs.best(f64::max)
    }

    fn decode_median(&self) -> Option<Duration> {
        let mut times: Vec<Duration> = self.decode_times.iter().copied().collect();
        times.sort_unstable();
        times.get(times.len() / 2).copied()
    }
}

/// Recent values of which the smallest or the largest counts.
#[derive(Clone, Debug, Default)]
struct Extremes(VecDeque<(Duration, f64)>);

impl Extremes {
    fn push(&mut self, value: f64, now: Duration, better: fn(f64, f64) -> f64) {
        self.0.retain(|(at, _)| now.saturating_sub(*at) <= MEMORY);
        // Values worse than the new one can never be the best again; dropping them keeps the queue short and sorted.
        while self.0.back().is_some_and(|(_, last)| better(*last, value) == value) {
            self.0.pop_back();
        }
        if self.0.len() == EXTREME_SAMPLES {
            self.0.pop_back();
        }
        self.0.push_back((now, value));
    }

    fn best(&self, better: fn(f64, f64) -> f64) -> Option<f64> {
        self.0.iter().map(|(_, value)| *value).reduce(better)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(value: u64) -> Duration {
        Duration::from_millis(value)
    }

    #[test]
    fn window_follows_round_trip_and_decoding() {
        let mut window = AckWindow::default();
        assert_eq!(window.frames(30.0), 2, "nothing is known yet");
        assert_eq!(window.sent(1000, ms(0)), 1);
        let acked = window.acked(1, ms(10), ms(60)).expect("in flight");
        assert_eq!(acked, Acked { frames: 1, round_trip: Some(ms(60)), queue_delay: Some(ms(0)) });
        assert_eq!(window.frames(30.0), 4, "ceil(0.07 s x 30) + 1");
        assert_eq!(window.frames(120.0), 6, "bounded");
        window.sent(1000, ms(100));
        let late = window.acked(2, ms(10), ms(260)).expect("in flight");
        assert_eq!(late.queue_delay, Some(ms(100)), "beyond the smallest");
        assert_eq!(window.frames(30.0), 4, "the smallest counts");
        window.sent(1000, ms(11_000));
        window.acked(3, ms(10), ms(11_150)).expect("in flight");
        assert_eq!(window.round_trip_min(), Some(ms(150)), "old ones are forgotten");
    }

    #[test]
    fn frames_and_bytes_close_it() {
        let mut window = AckWindow::default();
        window.sent(10, ms(0));
        assert!(window.has_room(30.0));
        window.sent(10, ms(1));
        assert!(!window.has_room(30.0), "two frames");
        window.acked(2, ms(1), ms(20)).expect("cumulative");
        assert_eq!(window.in_flight(), 0);
        window.sent(300 << 10, ms(30));
        assert!(!window.has_room(30.0), "256 KiB");
        window.acked(3, ms(1), ms(50)).expect("in flight");
        assert!(window.bytes() > 3 << 20, "a fast link earns more: {}", window.bytes());
    }

    #[test]
    fn invented_and_repeated_acks_change_nothing() {
        let mut window = AckWindow::default();
        window.sent(10, ms(0));
        window.sent(10, ms(0));
        for seq in [0, 3, 9, u32::MAX] {
            assert_eq!(window.acked(seq, ms(0), ms(5)), Err(AckError { seq }));
        }
        assert_eq!(window.in_flight(), 2);
        window.acked(1, ms(0), ms(5)).expect("in flight");
        assert!(window.acked(1, ms(0), ms(5)).is_err(), "repeated");
        assert_eq!(window.in_flight(), 1);
    }

    #[test]
    fn numbers_wrap() {
        let mut window = AckWindow::starting_at(u32::MAX);
        assert_eq!(window.sent(1, ms(0)), u32::MAX);
        assert_eq!(window.sent(1, ms(0)), 0);
        assert_eq!(window.acked(0, ms(0), ms(1)).map(|a| a.frames), Ok(2));
    }

    #[test]
    fn silence_counts_from_the_oldest_outstanding_frame() {
        let mut window = AckWindow::default();
        assert_eq!(window.silence(ms(99_000)), ms(0), "owes nothing");
        window.sent(1, ms(1000));
        window.sent(1, ms(2000));
        assert_eq!(window.silence(ms(5000)), ms(4000));
        window.acked(1, ms(0), ms(5000)).expect("in flight");
        assert_eq!(window.silence(ms(5500)), ms(500), "an ack is a sign of life");
    }

    #[test]
    fn a_suspended_tab_does_not_count_as_a_link() {
        let mut window = AckWindow::default();
        window.sent(1, ms(0));
        let acked = window.acked(1, ms(0), ms(20_000)).expect("in flight");
        assert_eq!((acked.round_trip, acked.queue_delay), (None, None));
        assert_eq!(window.frames(60.0), 2);
    }

    #[test]
    fn memory_is_bounded_whatever_happens() {
        let mut window = AckWindow::default();
        for i in 0..10_000u64 {
            let seq = window.sent(1000 + i, ms(i * 10));
            if i % 3 == 0 {
                window.acked(seq, ms(i % 50), ms(i * 10 + 5 + (i * 7919) % 90)).expect("in flight");
            }
            assert!(window.in_flight.len() <= 6);
            assert!(window.round_trips.0.len() <= EXTREME_SAMPLES && window.throughputs.0.len() <= EXTREME_SAMPLES);
            assert!(window.decode_times.len() <= DECODE_SAMPLES);
            assert_eq!(window.bytes_in_flight, window.in_flight.iter().map(|s| s.bytes).sum::<u64>());
        }
    }

    #[test]
    fn pacing_leaves_room_for_jitter() {
        let mut window = AckWindow::default();
        assert_eq!(window.next_send_at(30.0), ms(0));
        window.sent(1, ms(1000));
        assert_eq!(window.next_send_at(30.0).as_millis(), 1029, "nine tenths of a period");
    }
}
