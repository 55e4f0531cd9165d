//! What a PACS has sent last under each SOP Instance UID, what has been made of which images, and so what is closed.
//!
//! Whoever changes one of the three, an image, a rejection or what something was made of, calls [`judge`] in the same transaction.

use std::collections::BTreeSet;

use crate::identity::Rejection;
use case::images::{Fingerprint, Following, Image};
use case::series::{SeriesUids, Uid};
use case::{CaseId, LayerId};
use jiff::Timestamp;
use storage::args;
use storage::tables::{
    Connection, Row, as_it_is_known, new_id, read_closed, read_fingerprint, read_state, read_time,
    read_uid, read_uids, unreadable,
};
use storage::{Made, StoreError};

use super::PacsStore;
use super::columns::{count, read_count};
use crate::values::{
    ArrivalSource, LastImage, MadeCase, MadeImage, NewInstance, Rejected, Withdrawn,
};

impl PacsStore {
    /// Whether a PACS has sent an image with a UID.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn has_come(&self, image: &Uid) -> Result<bool, StoreError> {
        let last = last(&mut self.store.connect().await?, image).await?;
        Ok(last.is_some())
    }

    /// The latest rejections that stand: what notes have rejected of each series, newest first.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn rejections(&self, limit: usize) -> Result<Vec<Rejected>, StoreError> {
        let mut connection = self.store.connect().await?;
        let rows = connection
            .fetch_all(
                "SELECT id, study_uid, series_uid, count(*) AS instances, max(rejected_by) AS rejected_by, max(rejected_at) AS rejected_at,
                        min(may_return) AS may_return
                 FROM rejections WHERE study_uid <> '' GROUP BY id, study_uid, series_uid
                 ORDER BY max(rejected_at) DESC, id LIMIT $1",
                args![count(limit)],
            )
            .await?;
        let read = |row: &Row| {
            Ok(Rejected {
                id: row.get("id")?,
                study: row.get("study_uid")?,
                series: row.get("series_uid")?,
                images: read_count(row.get("instances")?),
                may_return: row.get::<i64>("may_return")? != 0,
                by: row.get("rejected_by")?,
                at: read_time(row, "rejected_at")?.to_string(),
            })
        };
        rows.iter().map(read).collect()
    }

    /// The cases that were made of any of these images, each with all of its own, newest first.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn made_of_any(&self, of: &[Image]) -> Result<Vec<MadeCase>, StoreError> {
        let mut connection = self.store.connect().await?;
        let mut ids = BTreeSet::new();
        for image in of {
            let rows = connection
                .fetch_all(
                    "SELECT case_id FROM made_of WHERE sop_instance_uid = $1 AND layer_id = '' AND result_id = ''",
                    args![image.uid.as_str()],
                )
                .await?;
            for row in &rows {
                ids.insert(row.get::<String>("case_id")?);
            }
        }
        let mut cases = Vec::with_capacity(ids.len());
        for id in ids {
            let row = connection
                .fetch_one(
                    "SELECT state, NULL AS job_state, closed, created_at FROM cases WHERE id = $1",
                    args![&id],
                )
                .await?;
            let state = read_state(&row).ok_or_else(|| unreadable("a state"))?;
            let created_at: i64 = row.get("created_at")?;
            let closed = read_closed(&row, "closed")?;
            let case = CaseId::parse(&id).ok_or_else(|| unreadable("a case"))?;
            let rows = connection
                .fetch_all(
                    "SELECT made_of.sop_instance_uid, made_of.fingerprint, made_of.times,
                            CAST(CASE WHEN images.times > made_of.times THEN 1 ELSE 0 END AS BIGINT) AS again,
                            CAST(CASE WHEN EXISTS (SELECT 1 FROM rejections
                                 WHERE rejections.sop_instance_uid = made_of.sop_instance_uid
                                   AND rejections.study_uid = images.study_uid AND rejections.series_uid = images.series_uid)
                                 THEN 1 ELSE 0 END AS BIGINT) AS rejected
                     FROM made_of LEFT JOIN images ON images.sop_instance_uid = made_of.sop_instance_uid
                     WHERE made_of.case_id = $1 AND made_of.layer_id = '' AND made_of.result_id = ''
                     ORDER BY made_of.sop_instance_uid",
                    args![&id],
                )
                .await?;
            let mut is_received = false;
            let read = |row: &Row| {
                is_received |= row.get::<i64>("times")? > 0;
                Ok::<_, StoreError>(MadeImage {
                    uid: read_uid(row, "sop_instance_uid")?,
                    fingerprint: read_fingerprint(row)?
                        .ok_or_else(|| unreadable("a fingerprint"))?,
                    has_come_again: row.get::<i64>("again")? != 0
                        || row.get::<i64>("rejected")? != 0,
                })
            };
            let images = rows.iter().map(read).collect::<Result<_, _>>()?;
            cases.push((
                created_at,
                MadeCase {
                    case,
                    state,
                    closed,
                    is_received,
                    images,
                },
            ));
        }
        cases.sort_by_key(|(created_at, made)| (std::cmp::Reverse(*created_at), made.case));
        Ok(cases.into_iter().map(|(_, case)| case).collect())
    }

    /// Notes that results are withdrawn, in whichever series they are.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub(crate) async fn withdraw(&self, instances: &[Uid]) -> Result<(), StoreError> {
        if instances.is_empty() {
            return Ok(());
        }
        let (mut transaction, now) = self.store.write().await?;
        let at = timestamp(now)?;
        for instance in instances {
            let withdrawn = Withdrawn {
                uids: None,
                instance: instance.clone(),
                at,
                id: String::new(),
                by: String::new(),
                may_return: false,
            };
            withdraw(&mut transaction, &withdrawn).await?;
        }
        transaction.commit().await
    }

    /// Whether each instance, such as a result, was withdrawn in whichever series.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn are_withdrawn(&self, instances: &[Uid]) -> Result<Vec<bool>, StoreError> {
        let mut connection = self.store.connect().await?;
        let mut are = Vec::with_capacity(instances.len());
        for instance in instances {
            let sql =
                "SELECT EXISTS (SELECT 1 FROM rejections WHERE sop_instance_uid = $1) AS withdrawn";
            let row = connection.fetch_one(sql, args![instance.as_str()]).await?;
            are.push(row.get("withdrawn")?);
        }
        Ok(are)
    }

    /// At most `limit` withdrawn instances after one, by UID and series.
    pub(crate) async fn withdrawn(
        &self,
        after: Option<&Withdrawn>,
        limit: usize,
    ) -> Result<Vec<Withdrawn>, StoreError> {
        let mut connection = self.store.connect().await?;
        let uids = after.and_then(|after| after.uids.as_ref());
        let rows = connection
            .fetch_all(
                "SELECT sop_instance_uid, study_uid, series_uid, rejected_at, id, rejected_by, may_return FROM rejections
                 WHERE (sop_instance_uid, study_uid, series_uid) > ($1, $2, $3)
                 ORDER BY sop_instance_uid, study_uid, series_uid LIMIT $4",
                args![
                    after.map_or("", |after| after.instance.as_str()),
                    uids.map_or("", |uids| uids.study.as_str()),
                    uids.map_or("", |uids| uids.series.as_str()), count(limit),
                ],
            )
            .await?;
        let read = |row: &Row| {
            let study: String = row.get("study_uid")?;
            Ok(Withdrawn {
                uids: (!study.is_empty()).then(|| read_uids(row)).transpose()?,
                instance: read_uid(row, "sop_instance_uid")?,
                at: read_time(row, "rejected_at")?,
                id: row.get("id")?,
                by: row.get("rejected_by")?,
                may_return: row.get::<i64>("may_return")? != 0,
            })
        };
        rows.iter().map(read).collect()
    }

    /// At most `limit` images after one, by UID.
    pub(crate) async fn last_images(
        &self,
        after: Option<&LastImage>,
        limit: usize,
    ) -> Result<Vec<LastImage>, StoreError> {
        let mut connection = self.store.connect().await?;
        let rows = connection
            .fetch_all(
                "SELECT sop_instance_uid, study_uid, series_uid, fingerprint, times, sender, last_at FROM images
                 WHERE sop_instance_uid > $1 ORDER BY sop_instance_uid LIMIT $2",
                args![after.map_or("", |after| after.uid.as_str()), count(limit)],
            )
            .await?;
        rows.iter().map(read_last).collect()
    }

    /// Notes that instances were withdrawn at these times in another store.
    pub(crate) async fn write_copied_withdrawn(
        &self,
        withdrawn: &[Withdrawn],
    ) -> Result<(), StoreError> {
        let (mut transaction, _) = self.store.write().await?;
        for withdrawn in withdrawn {
            withdraw(&mut transaction, withdrawn).await?;
        }
        let instances: Vec<_> = withdrawn.iter().map(|one| &one.instance).collect();
        judge(&mut transaction, &instances).await?;
        transaction.commit().await
    }

    /// Notes that images came as another store has them, unless others have come here since.
    pub(crate) async fn write_copied_images(&self, images: &[LastImage]) -> Result<(), StoreError> {
        let (mut transaction, _) = self.store.write().await?;
        for image in images {
            let here = last(&mut transaction, &image.uid).await?;
            if here.is_none_or(|here| here.last_at <= image.last_at) {
                write(&mut transaction, image).await?;
            }
        }
        let uids: Vec<_> = images.iter().map(|image| &image.uid).collect();
        judge(&mut transaction, &uids).await?;
        transaction.commit().await
    }
}

fn timestamp(now: i64) -> Result<Timestamp, StoreError> {
    Timestamp::from_microsecond(now).map_err(|_| unreadable("a time"))
}

async fn last(connection: &mut Connection, uid: &Uid) -> Result<Option<LastImage>, StoreError> {
    let row = connection
        .fetch_optional(
            "SELECT sop_instance_uid, study_uid, series_uid, fingerprint, times, sender, last_at FROM images
             WHERE sop_instance_uid = $1",
            args![uid.as_str()],
        )
        .await?;
    row.as_ref().map(read_last).transpose()
}

fn read_last(row: &Row) -> Result<LastImage, StoreError> {
    let sender: String = row.get("sender")?;
    Ok(LastImage {
        uid: read_uid(row, "sop_instance_uid")?,
        uids: read_uids(row)?,
        fingerprint: read_fingerprint(row)?,
        times: row.get("times")?,
        sender: ArrivalSource::from_name(&sender).ok_or_else(|| unreadable("a source"))?,
        last_at: row.get("last_at")?,
    })
}

/// The fingerprint of the last image with a UID.
pub(super) async fn last_sent(
    connection: &mut Connection,
    uid: &Uid,
) -> Result<Option<Fingerprint>, StoreError> {
    Ok(last(connection, uid)
        .await?
        .and_then(|last| last.fingerprint))
}

/// Whether the file of an image with the UID of another one is kept in its series.
async fn is_here(connection: &mut Connection, new: &NewInstance) -> Result<bool, StoreError> {
    let row = connection
        .fetch_one(
            "SELECT EXISTS (SELECT 1 FROM arrival_instances JOIN arrivals ON arrivals.id = arrival_id
                            WHERE sop_instance_uid = $1 AND study_uid = $2 AND series_uid = $3) AS here",
            args![
                new.sop_instance_uid.as_str(), new.uids.study.as_str(),
                new.uids.series.as_str()
            ],
        )
        .await?;
    row.get("here")
}

/// What an image is, beside the last one with its UID.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Arrived {
    /// None has come with this UID.
    First,
    Following(Following),
}

/// Notes that an image was sent, unless it is unusable, and judges what was made of the one before it. Adds the cases that were judged.
/// Returns also whether it was rejected until it came again.
pub(super) async fn arrive(
    connection: &mut Connection,
    new: &NewInstance,
    source: ArrivalSource,
    now: i64,
    changed: &mut Vec<CaseId>,
) -> Result<(Arrived, bool), StoreError> {
    let uid = &new.sop_instance_uid;
    let last = last(connection, uid).await?;
    let print = last.as_ref().and_then(|last| last.fingerprint.as_ref());
    let is_lossy =
        (print.zip(new.fingerprint.as_ref())).is_some_and(|(print, new)| new.has_lost(print));
    // It replaces nothing, and what is made of it would be closed at once.
    let is_unusable = is_lossy && !is_here(connection, new).await?;
    let arrived = match &last {
        None => Arrived::First,
        Some(last) => Arrived::Following(match (&last.fingerprint, &new.fingerprint) {
            (Some(_), Some(_)) if is_unusable => Following::Unusable,
            (Some(last), Some(new)) => last.followed_by(new),
            (Some(_), None) => Following::Unusable,
            (None, None) if last.uids == new.uids => Following::Same,
            (None, _) => Following::Another,
        }),
    };
    let times = last.as_ref().map_or(0, |last| last.times) + 1;
    let (uids, fingerprint) = match (arrived, last) {
        (Arrived::Following(Following::Unusable), _) => return Ok((arrived, false)),
        (Arrived::Following(Following::Same), Some(last)) => (last.uids, last.fingerprint),
        (_, last) => match &new.fingerprint {
            Some(fingerprint) => {
                let last = last.and_then(|last| last.fingerprint);
                let known = as_it_is_known(connection, uid, fingerprint, last.as_ref()).await?;
                (new.uids.clone(), Some(known))
            }
            None => (new.uids.clone(), None),
        },
    };
    let image = LastImage {
        uid: uid.clone(),
        uids,
        fingerprint,
        times,
        sender: source,
        last_at: now,
    };
    write(connection, &image).await?;
    let returned = connection
        .execute(
            "DELETE FROM rejections WHERE sop_instance_uid = $1 AND study_uid = $2 AND series_uid = $3 AND may_return = 1",
            args![uid.as_str(), new.uids.study.as_str(), new.uids.series.as_str()],
        )
        .await?;
    if returned > 0 || arrived != Arrived::Following(Following::Same) {
        changed.extend(judge(connection, &[uid]).await?);
    }
    Ok((arrived, returned > 0))
}

/// Stands for the fingerprint of an image of which the layers of a result show different versions. No image has it, so any version that a PACS
/// sends closes the result.
const NEVER_EQUAL: &str = "00000000000000000000000000000000:";

/// Notes of which images the layers were made that a result shows; they outlive the layers.
pub(super) async fn make_result(
    connection: &mut Connection,
    result: &Made,
    layers: &[LayerId],
) -> Result<(), StoreError> {
    for layer in layers {
        connection
            .execute(
                "INSERT INTO made_of (case_id, result_id, sop_instance_uid, fingerprint, times)
                 SELECT case_id, $1, sop_instance_uid, fingerprint, times FROM made_of
                 WHERE case_id = $2 AND layer_id = $3 AND result_id = ''
                 ON CONFLICT (case_id, layer_id, result_id, sop_instance_uid) DO UPDATE
                 SET fingerprint = CASE WHEN made_of.fingerprint = excluded.fingerprint THEN made_of.fingerprint ELSE $4 END",
                args![&result.result, &result.case, layer.to_string(), NEVER_EQUAL],
            )
            .await?;
    }
    judge_made(connection, result).await
}

/// Writes again what is closed of all that was made of images; the cases that it belongs to.
async fn judge(connection: &mut Connection, uids: &[&Uid]) -> Result<Vec<CaseId>, StoreError> {
    let mut all = BTreeSet::new();
    for uid in uids {
        let rows = connection
            .fetch_all(
                "SELECT case_id, layer_id, result_id FROM made_of WHERE sop_instance_uid = $1",
                args![uid.as_str()],
            )
            .await?;
        for row in &rows {
            all.insert(Made {
                case: row.get("case_id")?,
                layer: row.get("layer_id")?,
                result: row.get("result_id")?,
            });
        }
    }
    let mut judged = Vec::with_capacity(all.len());
    for made in &all {
        judge_made(connection, made).await?;
        judged.push(CaseId::parse(&made.case).ok_or_else(|| unreadable("a case"))?);
    }
    Ok(judged)
}

/// Writes whether something is closed. Series that are layers of a case which is closed are read again, for another one.
pub(super) async fn judge_made(connection: &mut Connection, made: &Made) -> Result<(), StoreError> {
    let Made {
        case,
        layer,
        result,
    } = made;
    // Bound values reach into the view, where columns of another table would let SQLite read all of it.
    let sql = match (&**layer, &**result) {
        ("", "") => {
            "UPDATE cases SET closed = coalesce((SELECT why FROM closed_by
                                                 WHERE case_id = $1 AND layer_id = $2 AND result_id = $3), 0)
             WHERE id = $1"
        }
        (_, "") => {
            "UPDATE layers SET closed = coalesce((SELECT why FROM closed_by
                                                  WHERE case_id = $1 AND layer_id = $2 AND result_id = $3), 0)
             WHERE case_id = $1 AND id = $2"
        }
        _ => {
            "UPDATE results SET closed = coalesce((SELECT why FROM closed_by
                                                   WHERE case_id = $1 AND layer_id = $2 AND result_id = $3), 0)
             WHERE id = $3 AND case_id = $1"
        }
    };
    connection.execute(sql, args![case, layer, result]).await?;
    if layer.is_empty() && result.is_empty() {
        wake_layers_of_closed(connection, case).await?;
    }
    Ok(())
}

/// Lets the series be read again that became layers of a case, if it is closed: another head of the study may have them.
pub(super) async fn wake_layers_of_closed(
    connection: &mut Connection,
    case: &str,
) -> Result<(), StoreError> {
    connection
        .execute(
            "UPDATE arrivals SET state = 'receiving', reason = NULL, case_id = NULL
             WHERE case_id = $1 AND instances > 0 AND state = 'layer'
               AND (SELECT closed FROM cases WHERE cases.id = $1) > 0",
            args![case],
        )
        .await?;
    Ok(())
}

/// Notes what a note rejects, and judges what was made of it; the cases that were judged.
pub(super) async fn reject(
    connection: &mut Connection,
    rejection: &Rejection,
    by: &str,
    now: i64,
) -> Result<Vec<CaseId>, StoreError> {
    let at = timestamp(now)?;
    for (uids, instances) in &rejection.series {
        let id = new_id();
        for uid in instances {
            let withdrawn = Withdrawn {
                uids: Some(uids.clone()),
                instance: uid.clone(),
                at,
                id: id.clone(),
                by: by.to_owned(),
                may_return: rejection.may_return,
            };
            withdraw(connection, &withdrawn).await?;
        }
    }
    let rejected: Vec<_> = (rejection.series.iter())
        .flat_map(|(_, instances)| instances)
        .collect();
    judge(connection, &rejected).await
}

/// Writes that an instance is rejected. One that was rejected before keeps the later time, and does not return if either note forbids it.
async fn withdraw(connection: &mut Connection, withdrawn: &Withdrawn) -> Result<(), StoreError> {
    let uids = withdrawn.uids.as_ref();
    connection
        .execute(
            "INSERT INTO rejections (sop_instance_uid, rejected_at, study_uid, series_uid, id, rejected_by, may_return)
             VALUES ($1, $2, $3, $4, $5, $6, $7)
             ON CONFLICT (sop_instance_uid, study_uid, series_uid) DO UPDATE
             SET rejected_at = excluded.rejected_at, id = excluded.id, rejected_by = excluded.rejected_by,
                 may_return = CASE WHEN rejections.may_return = 0 THEN 0 ELSE excluded.may_return END
             WHERE rejections.rejected_at <= excluded.rejected_at",
            args![
                withdrawn.instance.as_str(), withdrawn.at.as_microsecond(),
                uids.map_or("", |uids| uids.study.as_str()),
                uids.map_or("", |uids| uids.series.as_str()), &withdrawn.id, &withdrawn.by,
                i64::from(withdrawn.may_return),
            ],
        )
        .await?;
    Ok(())
}

/// Lifts what a note has rejected of a series; the series and its instances, or `None` if there is no such rejection. Adds the cases that
/// were judged.
pub(super) async fn lift(
    connection: &mut Connection,
    id: &str,
    changed: &mut Vec<CaseId>,
) -> Result<Option<(SeriesUids, Vec<Uid>)>, StoreError> {
    let rows = connection
        .fetch_all(
            "DELETE FROM rejections WHERE id = $1 AND study_uid <> '' RETURNING sop_instance_uid, study_uid, series_uid",
            args![id],
        )
        .await?;
    let Some(first) = rows.first() else {
        return Ok(None);
    };
    let uids = read_uids(first)?;
    let instances = rows
        .iter()
        .map(|row| read_uid(row, "sop_instance_uid"))
        .collect::<Result<Vec<_>, _>>()?;
    changed.extend(judge(connection, &instances.iter().collect::<Vec<_>>()).await?);
    Ok(Some((uids, instances)))
}

async fn write(connection: &mut Connection, image: &LastImage) -> Result<(), StoreError> {
    connection
        .execute(
            "INSERT INTO images (sop_instance_uid, study_uid, series_uid, fingerprint, times, sender, last_at)
             VALUES ($1, $2, $3, $4, $5, $6, $7)
             ON CONFLICT (sop_instance_uid) DO UPDATE
             SET study_uid = excluded.study_uid, series_uid = excluded.series_uid, fingerprint = excluded.fingerprint,
                 times = excluded.times, sender = excluded.sender, last_at = excluded.last_at",
            args![
                image.uid.as_str(), image.uids.study.as_str(), image.uids.series.as_str(),
                (image.fingerprint.as_ref()).map_or_else(String::new, Fingerprint::to_string),
                image.times, image.sender.name(), image.last_at,
            ],
        )
        .await?;
    Ok(())
}

/// Forgets images and rejections that are older than a time and that nothing names any more.
pub(super) async fn forget(connection: &mut Connection, before: i64) -> Result<(), StoreError> {
    connection
        .execute(
            "DELETE FROM images WHERE last_at <= $1
               AND NOT EXISTS (SELECT 1 FROM made_of WHERE made_of.sop_instance_uid = images.sop_instance_uid)
               AND NOT EXISTS (SELECT 1 FROM arrival_instances WHERE arrival_instances.sop_instance_uid = images.sop_instance_uid)",
            args![before],
        )
        .await?;
    connection
        .execute(
            "DELETE FROM rejections WHERE rejected_at <= $1
               AND NOT EXISTS (SELECT 1 FROM made_of WHERE made_of.sop_instance_uid = rejections.sop_instance_uid)
               AND NOT EXISTS (SELECT 1 FROM images WHERE images.sop_instance_uid = rejections.sop_instance_uid)",
            args![before],
        )
        .await?;
    Ok(())
}
