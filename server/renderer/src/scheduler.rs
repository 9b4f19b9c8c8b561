//! Who works next on the device, and which jobs are admitted.
//!
//! Views in a gesture come first. Views at rest and jobs share what is left: the next step goes to the one that has
//! used the least device time. No device in it: the actor measures the times and carries the steps out.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use crate::command::ViewKey;

/// Longest time for which a job lets others go first while its kernels are compiled.
const MAX_COMPILE_WAIT: Duration = Duration::from_secs(30);

/// Who does the next step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Worker {
    View(ViewKey),
    /// Index of an admitted job.
    Job(usize),
}

/// What is known of a view when the next worker is chosen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ViewLoad {
    pub(crate) key: ViewKey,
    /// Device time used, seconds.
    pub(crate) used_secs: f64,
    pub(crate) is_moving: bool,
    /// Whether a step would do something now.
    pub(crate) wants_step: bool,
}

/// What is known of an admitted job.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JobLoad {
    /// Device time used, seconds.
    pub(crate) used_secs: f64,
    /// Whether a step would do work rather than wait for a compiler.
    pub(crate) is_ready: bool,
}

/// Who does the next step; `None` when nobody has work.
pub(crate) fn next_worker(views: &[ViewLoad], jobs: &[JobLoad]) -> Option<Worker> {
    let awake = || views.iter().filter(|view| view.wants_step);
    let by_use = |a: &&ViewLoad, b: &&ViewLoad| a.used_secs.total_cmp(&b.used_secs);
    if let Some(view) = awake().filter(|view| view.is_moving).min_by(by_use) {
        return Some(Worker::View(view.key));
    }
    let view = awake().min_by(by_use);
    // A job whose kernels are still being compiled lets views go first; without views it waits for the compiler.
    let job = jobs
        .iter()
        .enumerate()
        .filter(|(_, job)| view.is_none() || job.is_ready)
        .min_by(|(_, a), (_, b)| a.used_secs.total_cmp(&b.used_secs));
    match (view, job) {
        (Some(view), Some((_, job))) if view.used_secs <= job.used_secs => Some(Worker::View(view.key)),
        (_, Some((index, _))) => Some(Worker::Job(index)),
        (Some(view), None) => Some(Worker::View(view.key)),
        (None, None) => None,
    }
}

/// Device time at which a new view or job starts: the least that anyone has used, so that it neither waits until the
/// others have used as much more, nor takes the device until it has caught up.
pub(crate) fn least_used(used_secs: impl Iterator<Item = f64>) -> f64 {
    used_secs.reduce(f64::min).unwrap_or(0.0)
}

/// A job that may work.
#[derive(Debug)]
pub(crate) struct Admitted<J> {
    pub(crate) job: J,
    /// Device time used, seconds.
    pub(crate) used_secs: f64,
    since: Instant,
}

impl<J> Admitted<J> {
    /// What the choice of the next worker needs to know, given whether a step would not have to wait for a compiler.
    pub(crate) fn load(&self, is_compiled: bool, now: Instant) -> JobLoad {
        let is_ready = is_compiled || now.duration_since(self.since) > MAX_COMPILE_WAIT;
        JobLoad { used_secs: self.used_secs, is_ready }
    }
}

/// Jobs that wait, first come first served, and those that were admitted, both up to a limit.
#[derive(Debug)]
pub(crate) struct JobQueue<J> {
    waiting: VecDeque<J>,
    admitted: Vec<Admitted<J>>,
    max_waiting: usize,
    max_admitted: usize,
}

impl<J> JobQueue<J> {
    pub(crate) const fn new(max_waiting: usize, max_admitted: usize) -> Self {
        Self { waiting: VecDeque::new(), admitted: Vec::new(), max_waiting, max_admitted }
    }

    /// Adds a job at the end, or hands it back where too many wait.
    pub(crate) fn submit(&mut self, job: J) -> Result<(), J> {
        if self.waiting.len() >= self.max_waiting {
            return Err(job);
        }
        self.waiting.push_back(job);
        Ok(())
    }

    /// Admits the job that has waited longest, where there is room. Its account opens at `used_secs`.
    pub(crate) fn admit(&mut self, used_secs: f64, now: Instant) -> Option<&J> {
        if self.admitted.len() >= self.max_admitted {
            return None;
        }
        let job = self.waiting.pop_front()?;
        self.admitted.push(Admitted { job, used_secs, since: now });
        self.admitted.last().map(|admitted| &admitted.job)
    }

    /// Jobs that may work; [`Worker::Job`] is an index into them.
    pub(crate) fn admitted(&self) -> &[Admitted<J>] {
        &self.admitted
    }

    pub(crate) fn admitted_mut(&mut self) -> &mut [Admitted<J>] {
        &mut self.admitted
    }

    /// Takes an admitted job out; the last one takes its index.
    pub(crate) fn take(&mut self, index: usize) -> J {
        self.admitted.swap_remove(index).job
    }

    /// Drops the jobs that are not to be kept, waiting or not.
    pub(crate) fn retain(&mut self, keep: impl Fn(&J) -> bool) {
        self.waiting.retain(&keep);
        self.admitted.retain(|admitted| keep(&admitted.job));
    }

    /// Takes all jobs out, admitted ones first.
    pub(crate) fn take_all(&mut self) -> impl Iterator<Item = J> {
        let admitted = std::mem::take(&mut self.admitted).into_iter().map(|admitted| admitted.job);
        admitted.chain(std::mem::take(&mut self.waiting))
    }

    pub(crate) fn is_any_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// Jobs, waiting or admitted.
    pub(crate) fn len(&self) -> usize {
        self.waiting.len() + self.admitted.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(key: u64, used_secs: f64) -> ViewLoad {
        ViewLoad { key: ViewKey(key), used_secs, is_moving: false, wants_step: true }
    }

    fn job(used_secs: f64) -> JobLoad {
        JobLoad { used_secs, is_ready: true }
    }

    #[test]
    fn a_view_in_a_gesture_comes_first_whatever_it_has_used() {
        let moving = ViewLoad { is_moving: true, ..view(2, 100.0) };
        assert_eq!(next_worker(&[view(1, 0.0), moving], &[job(0.0)]), Some(Worker::View(ViewKey(2))));
        let other = ViewLoad { is_moving: true, ..view(3, 99.0) };
        assert_eq!(next_worker(&[moving, other], &[]), Some(Worker::View(ViewKey(3))), "the one that used less");
        let asleep = ViewLoad { wants_step: false, ..other };
        assert_eq!(next_worker(&[moving, asleep], &[]), Some(Worker::View(ViewKey(2))));
    }

    #[test]
    fn views_at_rest_and_jobs_share_by_device_time() {
        assert_eq!(next_worker(&[view(1, 2.0), view(2, 1.0)], &[job(3.0)]), Some(Worker::View(ViewKey(2))));
        assert_eq!(next_worker(&[view(1, 2.0), view(2, 1.0)], &[job(3.0), job(0.5)]), Some(Worker::Job(1)));
        assert_eq!(next_worker(&[view(1, 1.0)], &[job(1.0)]), Some(Worker::View(ViewKey(1))), "the view of two equals");
        assert_eq!(next_worker(&[], &[job(9.0)]), Some(Worker::Job(0)));
        let asleep = ViewLoad { wants_step: false, ..view(1, 0.0) };
        assert_eq!(next_worker(&[asleep], &[]), None);
    }

    /// Everyone takes steps of their own length; who waited is served until the times are equal.
    #[test]
    fn device_time_is_shared_equally_and_a_newcomer_neither_waits_nor_takes_over() {
        let mut views = vec![view(0, 0.0)];
        let mut jobs = vec![job(0.0)];
        let step = |views: &mut Vec<ViewLoad>, jobs: &mut Vec<JobLoad>| match next_worker(views, jobs) {
            Some(Worker::View(key)) => views[key.0 as usize].used_secs += 0.03,
            Some(Worker::Job(index)) => jobs[index].used_secs += 0.08,
            None => panic!("somebody has work"),
        };
        for _ in 0..1000 {
            step(&mut views, &mut jobs);
        }
        assert!((views[0].used_secs - jobs[0].used_secs).abs() < 0.1, "{views:?} {jobs:?}");

        let before = [views[0].used_secs, jobs[0].used_secs];
        let newcomer = least_used(before.into_iter());
        assert!(newcomer == before[0].min(before[1]));
        views.push(view(1, newcomer));
        for _ in 0..1000 {
            step(&mut views, &mut jobs);
        }
        let used = [views[0].used_secs - before[0], views[1].used_secs - newcomer, jobs[0].used_secs - before[1]];
        assert!(used.iter().all(|secs| (secs - used[0]).abs() < 0.2), "{used:?}");
        assert!(least_used(std::iter::empty()) == 0.0);
    }

    #[test]
    fn a_job_whose_kernels_are_compiled_lets_views_go_first_for_a_while() {
        let start = Instant::now();
        let mut queue = JobQueue::new(1, 1);
        queue.submit(()).unwrap();
        queue.admit(0.0, start);
        let load = |secs| queue.admitted()[0].load(false, start + Duration::from_secs(secs));
        assert_eq!(next_worker(&[view(1, 5.0)], &[load(1)]), Some(Worker::View(ViewKey(1))));
        assert_eq!(next_worker(&[], &[load(1)]), Some(Worker::Job(0)), "alone it waits for the compiler");
        assert_eq!(next_worker(&[view(1, 5.0)], &[load(31)]), Some(Worker::Job(0)), "nor for ever");
        assert!(queue.admitted()[0].load(true, start).is_ready);
    }

    #[test]
    fn jobs_are_limited_and_admitted_in_order() {
        let now = Instant::now();
        let mut queue = JobQueue::new(2, 1);
        assert_eq!((queue.submit('a'), queue.submit('b'), queue.submit('c')), (Ok(()), Ok(()), Err('c')));
        assert_eq!(queue.admit(1.5, now), Some(&'a'));
        assert_eq!(queue.admit(1.5, now), None, "one at a time");
        assert!(queue.admitted()[0].used_secs == 1.5 && queue.is_any_waiting());
        assert_eq!(queue.submit('d'), Ok(()), "the admitted one no longer waits");
        assert_eq!(queue.len(), 3);
        assert_eq!(queue.take(0), 'a');
        assert_eq!(queue.admit(0.0, now), Some(&'b'));
        assert_eq!(queue.take_all().collect::<String>(), "bd");
        assert_eq!(queue.len(), 0);
    }

    #[test]
    fn abandoned_jobs_make_room() {
        let now = Instant::now();
        let mut queue = JobQueue::new(2, 1);
        queue.submit('a').unwrap();
        queue.admit(0.0, now);
        queue.submit('b').unwrap();
        queue.submit('c').unwrap();
        queue.retain(|job| *job == 'c');
        assert_eq!(queue.admit(0.0, now), Some(&'c'));
        assert!(!queue.is_any_waiting());
    }
}
