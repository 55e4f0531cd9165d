//! Command sets (PS3.7 §6.3): a few short elements in implicit little endian.

use crate::refusal::{Refusal, Status, error_comment};

/// Verification (PS3.4 A).
pub(crate) const VERIFICATION: &str = "1.2.840.10008.1.1";

/// The longest command set, in bytes. Those of C-STORE have some 200.
pub(crate) const MAX_LENGTH: usize = 16 << 10;

const C_STORE: u16 = 0x0001;
const C_ECHO: u16 = 0x0030;
const RESPONSE: u16 = 0x8000;

/// The value of (0000,0800) without a data set.
const NO_DATA_SET: u16 = 0x0101;

/// A value of (0000,0800) with one.
const SOME_DATA_SET: u16 = 0x0001;

const MEDIUM_PRIORITY: u16 = 0x0000;

/// Each association of ours has one request.
const OUR_MESSAGE_ID: u16 = 1;

/// The class and the instance of an object.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ObjectName {
    pub(crate) sop_class_uid: String,
    pub(crate) sop_instance_uid: String,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Request {
    Echo {
        message_id: u16,
    },
    Store {
        message_id: u16,
        object: ObjectName,
    },
    /// Another one, which may be followed by a data set.
    Other {
        message_id: u16,
        command_field: u16,
        has_data_set: bool,
    },
}

impl Request {
    /// Reads a command set; `None` if it is damaged or not a request.
    pub(crate) fn parse(bytes: &[u8]) -> Option<Self> {
        let mut command_field = None;
        let (mut message_id, mut data_set) = (None, None);
        let (mut class, mut instance) = (None, None);
        for (tag, value) in elements(bytes)? {
            match tag {
                0x0002 => class = Some(uid(value)?),
                0x0100 => command_field = Some(number(value)?),
                0x0110 => message_id = Some(number(value)?),
                0x0800 => data_set = Some(number(value)?),
                0x1000 => instance = Some(text(value)?),
                _ => {}
            }
        }
        let message_id = message_id?;
        let has_data_set = data_set? != NO_DATA_SET;
        match command_field? {
            C_ECHO if !has_data_set => Some(Self::Echo { message_id }),
            C_STORE if has_data_set => Some(Self::Store {
                message_id,
                object: ObjectName {
                    sop_class_uid: class?,
                    sop_instance_uid: instance?,
                },
            }),
            response if response & RESPONSE != 0 => None,
            command_field => Some(Self::Other {
                message_id,
                command_field,
                has_data_set,
            }),
        }
    }

    /// The response to it, with the beginning of the sentence that says why it was refused.
    pub(crate) fn response(&self, answer: &Result<Status, Refusal>) -> Vec<u8> {
        let (status, why) = match answer {
            Ok(status) => (*status, ""),
            Err(refusal) => (refusal.status, &*refusal.why),
        };
        let (field, message_id) = match self {
            Self::Echo { message_id } => (C_ECHO, *message_id),
            Self::Store { message_id, .. } => (C_STORE, *message_id),
            Self::Other {
                message_id,
                command_field,
                ..
            } => (*command_field, *message_id),
        };
        let mut elements = Vec::new();
        match self {
            Self::Echo { .. } => element(&mut elements, 0x0002, &padded(VERIFICATION)),
            Self::Store { object, .. } => {
                element(&mut elements, 0x0002, &padded(&object.sop_class_uid));
            }
            Self::Other { .. } => {}
        }
        element(&mut elements, 0x0100, &(field | RESPONSE).to_le_bytes());
        element(&mut elements, 0x0120, &message_id.to_le_bytes());
        element(&mut elements, 0x0800, &NO_DATA_SET.to_le_bytes());
        element(&mut elements, 0x0900, &(status as u16).to_le_bytes());
        if !why.is_empty() {
            let comment = error_comment(why);
            let even = comment.len().next_multiple_of(2);
            element(&mut elements, 0x0902, format!("{comment:even$}").as_bytes());
        }
        if let Self::Store { object, .. } = self {
            element(&mut elements, 0x1000, &padded(&object.sop_instance_uid));
        }
        command_set(elements)
    }
}

/// Our request to store an object, which its data set follows.
pub(crate) fn store_request(object: &ObjectName) -> Vec<u8> {
    let mut elements = Vec::new();
    element(&mut elements, 0x0002, &padded(&object.sop_class_uid));
    element(&mut elements, 0x0100, &C_STORE.to_le_bytes());
    element(&mut elements, 0x0110, &OUR_MESSAGE_ID.to_le_bytes());
    element(&mut elements, 0x0700, &MEDIUM_PRIORITY.to_le_bytes());
    element(&mut elements, 0x0800, &SOME_DATA_SET.to_le_bytes());
    element(&mut elements, 0x1000, &padded(&object.sop_instance_uid));
    command_set(elements)
}

/// Our request for an echo.
pub(crate) fn echo_request() -> Vec<u8> {
    let mut elements = Vec::new();
    element(&mut elements, 0x0002, &padded(VERIFICATION));
    element(&mut elements, 0x0100, &C_ECHO.to_le_bytes());
    element(&mut elements, 0x0110, &OUR_MESSAGE_ID.to_le_bytes());
    element(&mut elements, 0x0800, &NO_DATA_SET.to_le_bytes());
    command_set(elements)
}

/// The status in the response to [`store_request`] or [`echo_request`]; `None` if it is another message or damaged.
pub(crate) fn status_of_response(bytes: &[u8]) -> Option<u16> {
    let (mut field, mut message_id, mut status) = (None, None, None);
    for (tag, value) in elements(bytes)? {
        match tag {
            0x0100 => field = Some(number(value)?),
            0x0120 => message_id = Some(number(value)?),
            0x0900 => status = Some(number(value)?),
            _ => {}
        }
    }
    let fields = [C_STORE, C_ECHO].map(|field| field | RESPONSE);
    let is_ours = fields.contains(&field?) && message_id? == OUR_MESSAGE_ID;
    status.filter(|_| is_ours)
}

/// The elements of a command set by the second half of their tags; `None` if it is damaged.
fn elements(bytes: &[u8]) -> Option<Vec<(u16, &[u8])>> {
    let mut found = Vec::new();
    let mut rest = bytes;
    while !rest.is_empty() {
        let (head, after) = rest.split_at_checked(8)?;
        let length = u32::from_le_bytes(head[4..8].try_into().ok()?);
        let (value, after) = after.split_at_checked(usize::try_from(length).ok()?)?;
        rest = after;
        if head[..2] != [0, 0] {
            return None;
        }
        found.push((u16::from_le_bytes([head[2], head[3]]), value));
    }
    Some(found)
}

/// Elements with the length of all.
fn command_set(elements: Vec<u8>) -> Vec<u8> {
    let mut set = Vec::new();
    let length = u32::try_from(elements.len()).unwrap_or(u32::MAX);
    element(&mut set, 0x0000, &length.to_le_bytes());
    set.extend(elements);
    set
}

fn number(value: &[u8]) -> Option<u16> {
    Some(u16::from_le_bytes(value.try_into().ok()?))
}

/// A UID, with the byte that makes its length even or without it.
fn uid(value: &[u8]) -> Option<String> {
    let text = std::str::from_utf8(value).ok()?;
    case::series::Uid::parse(text).map(|uid| uid.as_str().to_owned())
}

/// A text of graphic characters that should be a UID: whether it is one is seen with the data set, so that one bad image does not end the
/// association.
fn text(value: &[u8]) -> Option<String> {
    let text = std::str::from_utf8(value)
        .ok()?
        .trim_end_matches(['\0', ' ']);
    let is_text = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_graphic());
    is_text.then(|| text.to_owned())
}

/// An element of group 0000.
fn element(set: &mut Vec<u8>, number: u16, value: &[u8]) {
    set.extend([0, 0]);
    set.extend(number.to_le_bytes());
    set.extend(u32::try_from(value.len()).unwrap_or(0).to_le_bytes());
    set.extend(value);
}

/// A UID of even length.
pub(crate) fn padded(uid: &str) -> Vec<u8> {
    let mut bytes = uid.as_bytes().to_vec();
    if bytes.len() % 2 == 1 {
        bytes.push(0);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn store() -> Vec<u8> {
        let mut set = Vec::new();
        element(&mut set, 0x0000, &100_u32.to_le_bytes());
        element(&mut set, 0x0002, &padded("1.2.840.10008.5.1.4.1.1.4"));
        element(&mut set, 0x0100, &C_STORE.to_le_bytes());
        element(&mut set, 0x0110, &7_u16.to_le_bytes());
        element(&mut set, 0x0700, &0_u16.to_le_bytes());
        element(&mut set, 0x0800, &1_u16.to_le_bytes());
        element(&mut set, 0x1000, &padded("1.2.3"));
        set
    }

    #[test]
    fn a_request_is_read_and_its_response_names_it() {
        let request = Request::parse(&store()).unwrap();
        let expected = Request::Store {
            message_id: 7,
            object: ObjectName {
                sop_class_uid: "1.2.840.10008.5.1.4.1.1.4".to_owned(),
                sop_instance_uid: "1.2.3".to_owned(),
            },
        };
        assert_eq!(request, expected);
        let response = request.response(&Ok(Status::Success));
        let group_length = u32::from_le_bytes(response[8..12].try_into().unwrap());
        assert_eq!(group_length as usize, response.len() - 12);
        assert_eq!(Request::parse(&response), None, "it is no request");
        let refused = Refusal::new(Status::OutOfResources, "“Rows” is missing");
        let refused = request.response(&Err(refused));
        let comment = b"\x00\x00\x02\x09\x10\x00\x00\x00Rows is missing ";
        assert!(memchr::memmem::find(&refused, comment).is_some());
        let status = [0, 0, 0x00, 0x09, 2, 0, 0, 0, 0x00, 0xA7];
        assert!(memchr::memmem::find(&refused, &status).is_some());
    }

    #[test]
    fn an_instance_whose_uid_is_none_is_a_request_all_the_same() {
        let of = |class: &str, instance: &str| {
            Request::parse(&store_request(&ObjectName {
                sop_class_uid: class.to_owned(),
                sop_instance_uid: instance.to_owned(),
            }))
        };
        let class = "1.2.840.10008.5.1.4.1.1.4";
        let Some(Request::Store { object, .. }) = of(class, "anonymized") else {
            panic!("it is refused with its image, and the association goes on");
        };
        assert_eq!(object.sop_instance_uid, "anonymized");
        for (class, instance) in [("anonymized", "1.2.3"), (class, ""), (class, "a b")] {
            assert_eq!(of(class, instance), None, "{class} {instance}");
        }
    }

    #[test]
    fn our_request_is_understood_and_its_response_has_its_status() {
        let object = ObjectName {
            sop_class_uid: "1.2.840.10008.5.1.4.1.1.7".to_owned(),
            sop_instance_uid: "2.25.7".to_owned(),
        };
        let request = Request::parse(&store_request(&object)).unwrap();
        let message_id = OUR_MESSAGE_ID;
        assert_eq!(request, Request::Store { message_id, object });
        let response = request.response(&Ok(Status::Corrected));
        assert_eq!(status_of_response(&response), Some(0xB000));
        assert_eq!(status_of_response(&response[..40]), None);
        let echo = Request::Echo { message_id };
        let echoed = echo.response(&Ok(Status::Success));
        assert_eq!(status_of_response(&echoed), Some(0));
        let other = Request::parse(&store()).unwrap();
        assert_eq!(
            status_of_response(&other.response(&Ok(Status::Success))),
            None
        );
    }

    #[test]
    fn lengths_that_lie_are_refused() {
        for length in [0_u32, 1, 100, u32::MAX] {
            let mut set = store();
            set[4 + 12..8 + 12].copy_from_slice(&length.to_le_bytes());
            assert_eq!(Request::parse(&set), None, "{length}");
        }
        for cut in 1..store().len() {
            assert_eq!(Request::parse(&store()[..cut]), None, "{cut}");
        }
    }

    proptest! {
        #[test]
        fn nothing_that_is_changed_on_the_way_is_a_panic(
            changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        ) {
            let mut set = store();
            for (at, byte) in changes {
                let at = at.index(set.len());
                set[at] = byte;
            }
            status_of_response(&set);
            if let Some(request) = Request::parse(&set) {
                request.response(&Ok(Status::Success));
            }
        }
    }
}
