//! Wall-clock and CPU time of a piece of work.

use std::time::Instant;

use crate::Summary;

/// The cost of a piece of work.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cost {
    /// Wall-clock time, in seconds.
    pub wall_s: f64,
    /// CPU time of all threads of this process, in seconds; `None` if the system does not report it.
    pub cpu_s: Option<f64>,
}

impl Cost {
    /// The cost of this piece of work followed by `other`.
    pub fn and(self, other: Self) -> Self {
        Self {
            wall_s: self.wall_s + other.wall_s,
            cpu_s: self.cpu_s.zip(other.cpu_s).map(|(a, b)| a + b),
        }
    }

    /// The cost of one of `parts` equal parts of the work.
    pub fn shared_by(self, parts: usize) -> Self {
        let share = 1.0 / parts.max(1) as f64;
        Self {
            wall_s: self.wall_s * share,
            cpu_s: self.cpu_s.map(|cpu_s| cpu_s * share),
        }
    }
}

/// The readings of both clocks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Instants {
    cpu_s: Option<f64>,
    wall: Instant,
}

impl Instants {
    pub(crate) fn now() -> Self {
        Self {
            cpu_s: process_cpu_s(),
            wall: Instant::now(),
        }
    }

    /// The cost since then.
    pub(crate) fn cost(self) -> Cost {
        let wall_s = self.wall.elapsed().as_secs_f64();
        let cpu_s = process_cpu_s().zip(self.cpu_s);
        Cost {
            wall_s,
            cpu_s: cpu_s.map(|(after, before)| after - before),
        }
    }
}

/// Performs some work and returns its result and cost.
pub fn timed<T>(work: impl FnOnce() -> T) -> (T, Cost) {
    let begin = Instants::now();
    let result = work();
    (result, begin.cost())
}

/// The costs of repetitions of the same work.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Costs(Vec<Cost>);

impl Costs {
    /// Performs some work `times` times, at least once.
    pub fn of<T>(times: usize, mut work: impl FnMut() -> T) -> Self {
        let once = |_| {
            let (result, cost) = timed(&mut work);
            // The result is dropped outside the timing, because in real use it lives on.
            drop(result);
            cost
        };
        Self((0..times.max(1)).map(once).collect())
    }

    /// Adds one more.
    pub fn push(&mut self, cost: Cost) {
        self.0.push(cost);
    }

    /// All of them.
    pub fn all(&self) -> &[Cost] {
        &self.0
    }

    /// Wall-clock times, in seconds; `None` without repetitions.
    pub fn wall_s(&self) -> Option<Summary> {
        Summary::of(self.0.iter().map(|cost| cost.wall_s))
    }

    /// CPU times, in seconds; `None` without repetitions, or if the system does not report them.
    pub fn cpu_s(&self) -> Option<Summary> {
        let times: Option<Vec<f64>> = self.0.iter().map(|cost| cost.cpu_s).collect();
        Summary::of(times?)
    }

    /// The least CPU time, or wall-clock time if the system does not report it: the figure that other load disturbs
    /// least.
    pub fn least_s(&self) -> f64 {
        let least = self.cpu_s().or_else(|| self.wall_s());
        least.map_or(0.0, |summary| summary.least)
    }
}

impl FromIterator<Cost> for Costs {
    fn from_iter<I: IntoIterator<Item = Cost>>(costs: I) -> Self {
        Self(costs.into_iter().collect())
    }
}

/// CPU time of this process so far, in seconds.
#[cfg(unix)]
fn process_cpu_s() -> Option<f64> {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Some(time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9)
}

#[cfg(not(unix))]
fn process_cpu_s() -> Option<f64> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    const COST: Cost = Cost {
        wall_s: 4.0,
        cpu_s: Some(6.0),
    };

    #[test]
    fn costs_add_up_and_are_shared() {
        let both = COST.and(COST);
        assert_eq!((both.wall_s, both.cpu_s), (8.0, Some(12.0)));
        let share = both.shared_by(4);
        assert_eq!((share.wall_s, share.cpu_s), (2.0, Some(3.0)));
        let untold = COST.and(Cost {
            wall_s: 1.0,
            cpu_s: None,
        });
        assert_eq!((untold.wall_s, untold.cpu_s), (5.0, None));
    }

    #[test]
    fn the_processor_time_of_some_costs_is_known_only_if_it_is_of_each() {
        let mut costs: Costs = [COST, COST].into_iter().collect();
        assert_eq!(costs.cpu_s().unwrap().median, 6.0);
        assert_eq!(costs.least_s(), 6.0);
        costs.push(Cost {
            wall_s: 2.0,
            cpu_s: None,
        });
        assert_eq!(costs.cpu_s(), None);
        assert_eq!(costs.least_s(), 2.0);
    }

    #[test]
    fn work_is_done_as_often_as_was_said_and_takes_time() {
        let mut count = 0;
        let costs = Costs::of(3, || {
            count += 1;
            (0..100_000_u64).map(std::hint::black_box).sum::<u64>()
        });
        assert_eq!((count, costs.all().len()), (3, 3));
        assert!(costs.all().iter().all(|cost| cost.wall_s > 0.0));
        #[cfg(unix)]
        assert!(costs.cpu_s().unwrap().greatest > 0.0);
    }
}
