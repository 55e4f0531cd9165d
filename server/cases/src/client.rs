//! The client of the request that a task runs.

use case::Client;

tokio::task_local! {
    static CLIENT: Client;
}

/// Runs a request of a client: what it does in a [`ConcurrencyLimit`](crate::ConcurrencyLimit) takes turns with the work of others.
pub async fn for_client<F: Future>(client: Client, request: F) -> F::Output {
    CLIENT.scope(client, request).await
}

/// The client of the request that this task runs.
pub(crate) fn this_client() -> Client {
    CLIENT.try_with(|client| *client).unwrap_or_default()
}

/// What stands for a client in the store; empty for this program. It has neither an address nor a name.
pub(crate) fn in_store(client: Client) -> String {
    match client {
        Client::Program => String::new(),
        Client::Address(address) => {
            blake3::hash(address.to_string().as_bytes()).to_hex()[..16].to_owned()
        }
        Client::Named(name) => format!("{:016x}-named", u64::from_be_bytes(name)),
    }
}
