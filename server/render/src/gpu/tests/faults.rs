//! A device that is missing, lost or overloaded, or whose client has left.

use std::process::Command;

use super::super::{Fault, GpuError, GpuJob, GpuOptions, GpuPool};
use super::support::{Case, LIMITS, parameters, skip, trace, worker};
use crate::{FrameSize, NamedView, RenderParameters};

/// Set in the process that runs without a driver.
const CHILD: &str = "ISOCORTEX_TEST_CHILD";

#[test]
fn a_machine_without_a_driver_says_so() {
    if std::env::var_os(CHILD).is_some() {
        let error = GpuPool::start(GpuOptions::default())
            .map(|_| ())
            .unwrap_err();
        assert!(matches!(error, GpuError::NoAdapter { .. }), "{error:?}");
        assert!(
            error
                .to_string()
                .starts_with("no graphics adapter was found")
        );
        return;
    }
    let this = "gpu::tests::faults::a_machine_without_a_driver_says_so";
    let output = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", this])
        .env(CHILD, "1")
        .env("VK_DRIVER_FILES", "/nonexistent/driver.json")
        .env("VK_ICD_FILENAMES", "/nonexistent/driver.json")
        .env("__EGL_VENDOR_LIBRARY_FILENAMES", "/nonexistent/vendor.json")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}");
    assert!(said.contains("1 passed"), "{said}");
}

fn pool(options: GpuOptions) -> Option<GpuPool> {
    GpuPool::start(options).map_err(|error| skip(&error)).ok()
}

#[test]
fn a_device_that_is_destroyed_is_opened_again() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    let case = Case::ball(20);
    let job = trace(&case, parameters(NamedView::Left, 4.0));
    let expected = worker.attempt(|renderer| renderer.draw(&job)).unwrap();
    worker
        .attempt(|renderer| {
            renderer.open.device.destroy();
            Ok(())
        })
        .unwrap();
    let again = worker.attempt(|renderer| renderer.draw(&job)).unwrap();
    assert_eq!(again, expected);
    assert_eq!(worker.reopened(), 1);
}

#[test]
fn a_device_that_is_destroyed_while_it_draws_is_opened_again() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    let case = Case::ball(21);
    let job = trace(&case, parameters(NamedView::Left, 4.0));
    let expected = worker.attempt(|renderer| renderer.draw(&job)).unwrap();
    let device = worker
        .attempt(|renderer| Ok(renderer.open.device.clone()))
        .unwrap();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            std::thread::sleep(std::time::Duration::from_millis(15));
            device.destroy();
        });
        let begun = std::time::Instant::now();
        while worker.reopened() == 0 && begun.elapsed().as_secs() < 60 {
            assert_eq!(
                worker.attempt(|renderer| renderer.draw(&job)).unwrap(),
                expected
            );
        }
    });
    assert_eq!(worker.reopened(), 1);
}

#[test]
fn sixty_four_pictures_at_once_on_two_threads_are_those_of_one() {
    let options = GpuOptions {
        threads: 2,
        queue: 64,
        ..GpuOptions::default()
    };
    let Some(pool) = pool(options) else { return };
    let case = Case::ball(22);
    let jobs: Vec<GpuJob> = (0..64)
        .map(|index| {
            let view = NamedView::ALL[index % 6];
            trace(&case, parameters(view, (index / 6) as f64))
        })
        .collect();
    let tickets: Vec<_> = jobs
        .iter()
        .map(|job| pool.begin_draw(job.clone()).unwrap())
        .collect();
    let drawn: Vec<_> = tickets
        .into_iter()
        .map(|ticket| ticket.wait().unwrap())
        .collect();
    for (job, drawn) in jobs.into_iter().zip(drawn) {
        assert_eq!(pool.draw(job).unwrap(), drawn);
    }
}

#[test]
fn a_full_queue_says_so_and_the_next_picture_is_drawn() {
    let options = GpuOptions {
        queue: 2,
        ..GpuOptions::default()
    };
    let Some(pool) = pool(options) else { return };
    let case = Case::ball(23);
    let job = trace(&case, parameters(NamedView::Left, 4.0));
    let tickets: Vec<_> = (0..200).map(|_| pool.begin_draw(job.clone())).collect();
    let refused = tickets
        .iter()
        .filter(|ticket| matches!(ticket, Err(GpuError::Busy)));
    assert!(refused.count() > 0);
    for ticket in tickets.into_iter().flatten() {
        assert!(ticket.wait().is_ok());
    }
    assert!(pool.draw(job).is_ok());
}

/// Two attempts at a picture find no memory, so the next picture fails.
const SHORT_FOR_ONE: Fault = Fault::OutOfMemory(2);

#[test]
fn who_leaves_before_his_turn_costs_nothing() {
    let Some(pool) = pool(GpuOptions::default()) else {
        return;
    };
    let case = Case::ball(25);
    let large = RenderParameters {
        size: FrameSize::new(1500, 1500).unwrap(),
        ..parameters(NamedView::Left, 4.0)
    };
    let begin = || pool.begin_draw(trace(&case, large)).unwrap();
    for is_left in [true, false] {
        let slow: Vec<_> = (0..3).map(|_| begin()).collect();
        pool.break_device(SHORT_FOR_ONE).unwrap();
        let waited_for = (!is_left).then(begin);
        if is_left {
            drop(begin());
        }
        for ticket in slow {
            ticket.wait().unwrap();
        }
        // A waiting client gets the fault; if it has left, the next one gets it.
        if let Some(ticket) = waited_for {
            assert_eq!(ticket.wait(), Err(GpuError::OutOfMemory));
        }
        let next = pool.draw(trace(&case, parameters(NamedView::Left, 4.0)));
        assert_eq!(next.err(), is_left.then_some(GpuError::OutOfMemory));
    }
}

#[test]
fn a_panic_costs_a_picture_and_not_the_pool() {
    let Some(pool) = pool(GpuOptions::default()) else {
        return;
    };
    let case = Case::ball(26);
    let job = trace(&case, parameters(NamedView::Left, 4.0));
    let expected = pool.draw(job.clone()).unwrap();
    pool.break_device(Fault::Panic).unwrap();
    let failed = pool.draw(job.clone());
    assert!(matches!(failed, Err(GpuError::Failed { .. })));
    assert_eq!(pool.draw(job).unwrap(), expected);
}
