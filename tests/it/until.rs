//! Waiting for what another task or process does.

use std::time::Duration;

/// The time between two questions.
const EVERY: Duration = Duration::from_millis(20);

/// The longest wait: tests of a debug build run on busy machines.
const PATIENCE: Duration = Duration::from_secs(120);

/// Asks until there is an answer.
///
/// # Panics
/// With what is waited for, if it does not happen.
pub(crate) async fn until<T>(waited_for: &str, mut ask: impl AsyncFnMut() -> Option<T>) -> T {
    let answered = async {
        loop {
            if let Some(answer) = ask().await {
                return answer;
            }
            tokio::time::sleep(EVERY).await;
        }
    };
    match tokio::time::timeout(PATIENCE, answered).await {
        Ok(answer) => answer,
        Err(_) => panic!("it does not happen that {waited_for}"),
    }
}
