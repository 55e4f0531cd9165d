//! The nodes of the configuration, from which series are fetched by DICOMweb, and to which results are sent by STOW-RS or
//! C-STORE.
//!
//! Only these are ever asked: clients name a node, never an address. Errors contain no texts of a node.

pub(crate) mod error;
mod web;

use bytes::Bytes;
use case::series::Uid;

use crate::dimse::StorageNode;

pub use self::error::{BadNode, NodeError};
pub use self::web::{Credentials, WebNode};

/// A node. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Node {
    name: String,
    web: Option<WebNode>,
    recipient: Recipient,
}

/// Where results go.
#[derive(Debug, Clone)]
enum Recipient {
    Web(WebNode),
    Storage(StorageNode),
}

impl Node {
    /// A node from which series are fetched by DICOMweb, and to which results are sent by C-STORE, or else by STOW-RS.
    ///
    /// # Errors
    /// [`BadNode`].
    pub fn new(
        name: &str,
        web: Option<WebNode>,
        storage: Option<StorageNode>,
    ) -> Result<Self, BadNode> {
        let allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if !(1..=32).contains(&name.len()) || !name.chars().all(allowed) {
            return Err(BadNode::Name);
        }
        let recipient = match (storage, &web) {
            (Some(storage), _) => Recipient::Storage(storage),
            (None, Some(web)) => Recipient::Web(web.clone()),
            (None, None) => return Err(BadNode::NoService),
        };
        Ok(Self {
            name: name.to_owned(),
            web,
            recipient,
        })
    }

    /// Its name in requests.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its DICOMweb server, if it has one.
    pub(crate) fn web(&self) -> Option<&WebNode> {
        self.web.as_ref()
    }

    /// Asks each of its services whether it is there, in the words of the configuration.
    pub(crate) async fn test(&self) -> Vec<(&'static str, Result<(), NodeError>)> {
        let mut answers = Vec::new();
        if let Some(web) = &self.web {
            answers.push(("dicomweb", web.test().await));
        }
        if let Recipient::Storage(node) = &self.recipient {
            answers.push(("c-store", node.echo().await));
        }
        answers
    }

    /// Stores an object. Afterwards the node has it.
    pub(crate) async fn store(&self, instance: &Uid, file: &Bytes) -> Result<(), NodeError> {
        match &self.recipient {
            Recipient::Web(web) => web.store(instance, file).await,
            Recipient::Storage(node) => node.store(file).await,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_has_a_plain_name_and_some_service() {
        let web = || WebNode::new("http://orthanc/", &Credentials::None).unwrap();
        let storage = || StorageNode::new("orthanc:104", "ORTHANC", "ISOCORTEX").unwrap();
        for name in ["", "a b", "../x"] {
            let refused = Node::new(name, Some(web()), None).err();
            assert_eq!(refused, Some(BadNode::Name));
        }
        assert_eq!(Node::new("a", None, None).err(), Some(BadNode::NoService));
        let both = Node::new("a", Some(web()), Some(storage())).unwrap();
        assert!(both.web().is_some() && matches!(both.recipient, Recipient::Storage(_)));
        let results_only = Node::new("a", None, Some(storage())).unwrap();
        assert!(results_only.web().is_none());
    }
}
