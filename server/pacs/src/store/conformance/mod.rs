//! Checks of the rows of the PACS: one suite, for SQLite in memory and in a file, and for PostgreSQL.

mod arrivals;
mod results;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use storage::testing::postgres::PostgresServer;
use storage::{DatabaseAddress, Location, Options, Store};
use tempfile::TempDir;

use self::arrivals::*;
pub(crate) use self::results::*;
use super::{PacsStore, PacsTables};

/// A store to check, empty.
pub(crate) struct Subject {
    pub(crate) store: PacsStore,
    _folder: Option<TempDir>,
}

fn options() -> Options {
    Options {
        tables: Arc::new(PacsTables),
        ..Options::default()
    }
}

/// The store in a folder.
pub(crate) async fn open(folder: &Path) -> PacsStore {
    PacsStore::new(Store::open(folder, options()).await.unwrap())
}

impl Subject {
    pub(crate) async fn in_memory() -> Self {
        let store = Store::in_memory(options()).await;
        Self {
            store: PacsStore::new(store.unwrap()),
            _folder: None,
        }
    }

    async fn in_a_file() -> Self {
        Self::at(None).await
    }

    async fn at(database: Option<DatabaseAddress>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let location = Location {
            database,
            ..folder.path().into()
        };
        let store = Store::open(location, options()).await;
        Self {
            store: PacsStore::new(store.unwrap()),
            _folder: Some(folder),
        }
    }

    pub(crate) fn pass(&self, seconds: u64) {
        self.store.store().pass_time(Duration::from_secs(seconds));
    }
}

/// Writes a test of each check for SQLite in memory and in a file, and one of all for PostgreSQL, which is slow to start.
macro_rules! conformance {
    ($($check:ident)+) => {
        mod memory {
            use super::*;
            $(
                #[tokio::test]
                async fn $check() {
                    super::$check(&Subject::in_memory().await).await;
                }
            )+
        }

        mod file {
            use super::*;
            $(
                #[tokio::test]
                async fn $check() {
                    super::$check(&Subject::in_a_file().await).await;
                }
            )+
        }

        #[tokio::test]
        async fn postgres() {
            let Some(server) = PostgresServer::start().await else {
                return;
            };
            $(
                println!("{}", stringify!($check));
                let address = DatabaseAddress::parse(&server.database().await).unwrap();
                // In a box: all of them in one future would not fit into the stack.
                Box::pin(async { $check(&Subject::at(Some(address)).await).await }).await;
            )+
        }
    };
}

conformance! {
    an_image_is_received_once
    a_case_is_closed_while_the_last_image_is_another_one
    an_unchanged_image_wakes_a_series_that_waits_for_it
    what_replaces_a_closed_case_inherits_nothing
    objects_that_are_not_kept_are_counted
    what_is_refused_is_counted_and_makes_few_rows
    an_image_that_comes_under_another_series_leaves_its_own
    what_is_made_of_rejected_images_is_closed_until_that_is_lifted
    what_a_pacs_has_sent_is_known_for_a_year_and_while_something_is_made_of_it
    nothing_is_forgotten_by_a_wrong_clock_or_in_the_first_hour
    a_series_is_due_when_nothing_came_for_a_while
    a_corrected_or_grown_series_waits_as_if_no_number_were_known
    a_series_with_all_announced_images_waits_no_longer
    a_late_image_fences_the_reader_off_and_makes_the_series_due_again
    a_series_that_is_not_t1_waits_for_a_case_of_its_study
    an_image_is_kept_until_its_series_is_forgotten_or_its_case_deleted
    images_that_have_changed_do_not_go_with_the_case_that_was_made_before
    series_are_listed_newest_first_in_pages
    series_are_listed_by_state_case_label_and_time
    a_series_that_was_refused_is_taken_and_the_reason_stays
    a_result_is_queued_once_for_a_node_and_sent_until_it_is_there
    a_result_is_kept_until_it_is_forgotten_or_its_case_deleted
    results_are_listed_by_case_and_state_in_pages
    a_result_does_not_count_while_what_it_shows_is_closed
}
