//! Questions about a point of the frame that the client sees: what is there, and what lights it.

use surfelcast_protocol::inspection::{Column, Disc, Field, FieldValue, Inspection, Row};
use surfelcast_protocol::server::ServerMessage;
use surfelcast_render_api as api;
use surfelcast_renderer::{RendererError, RendererHandle, SessionKey};
use tokio::sync::mpsc;

use crate::live::refusal::Refusal;
use crate::live::sent_log::AckedView;

/// Points that the renderer may look at for one client at a time.
const MAX_IN_FLIGHT: usize = 4;

/// What is asked about a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PointQuestion {
    /// Which surface is there.
    Pick,
    /// What lights it.
    Inspect,
}

impl PointQuestion {
    /// Name of the message that asks it.
    fn name(self) -> &'static str {
        match self {
            Self::Pick => "pick",
            Self::Inspect => "inspect",
        }
    }

    async fn ask(
        self,
        handle: &RendererHandle,
        session: SessionKey,
        view: AckedView,
        point: [f32; 2],
        re: Option<u64>,
    ) -> Result<ServerMessage, RendererError> {
        Ok(match self {
            Self::Pick => {
                let picked = handle.pick(session, view.camera, view.aspect(), point).await?;
                let (position, object) = picked.map(|p| (p.position.to_array(), p.object)).unzip();
                ServerMessage::Picked { re, position, object }
            }
            Self::Inspect => {
                let found = handle.inspect(session, view.camera, view.size, point).await?;
                let inspection = found.map(|found| Box::new(in_protocol(&found)));
                match inspection.as_ref().and_then(|inspection| inspection.not_finite()) {
                    Some(field) => self.failed(re, &format!("{field} is not a finite number")),
                    None => ServerMessage::Inspected { re, inspection },
                }
            }
        })
    }

    fn failed(self, re: Option<u64>, why: &str) -> ServerMessage {
        let name = self.name();
        ServerMessage::Error { re, code: format!("{name}_failed"), detail: format!("{name}: {why}") }
    }
}

/// The questions of one client that the renderer has not answered yet.
#[derive(Debug)]
pub(crate) struct PointQuestions {
    handle: RendererHandle,
    session: SessionKey,
    in_flight: usize,
    sender: mpsc::Sender<ServerMessage>,
    answers: mpsc::Receiver<ServerMessage>,
}

impl PointQuestions {
    pub(crate) fn new(handle: RendererHandle, session: SessionKey) -> Self {
        let (sender, answers) = mpsc::channel(MAX_IN_FLIGHT);
        Self { handle, session, in_flight: 0, sender, answers }
    }

    /// Asks the renderer about a point of the frame that the client sees; the answer follows when the renderer has
    /// looked. Answers that are outstanding are bounded.
    pub(crate) fn ask(
        &mut self,
        question: PointQuestion,
        view: Option<AckedView>,
        point: [f32; 2],
        re: Option<u64>,
    ) -> Result<(), Refusal> {
        let name = question.name();
        let Some(view) = view else {
            let detail = format!("{name}: no frame was acknowledged yet, so there is no picture to point into");
            return Err(Refusal::no_frame(detail));
        };
        if self.in_flight >= MAX_IN_FLIGHT {
            let detail = format!("{name}: {MAX_IN_FLIGHT} points are being looked at already; wait for an answer");
            return Err(Refusal::busy(detail));
        }
        self.in_flight += 1;
        let (handle, session, sender) = (self.handle.clone(), self.session, self.sender.clone());
        drop(tokio::spawn(async move {
            let answer = question.ask(&handle, session, view, point, re).await;
            let message = answer.unwrap_or_else(|error| question.failed(re, &error.to_string()));
            // The connection may be gone by now.
            let _ = sender.send(message).await;
        }));
        Ok(())
    }

    /// Waits for the next answer. Cancel-safe.
    pub(crate) async fn answer(&mut self) -> ServerMessage {
        match self.answers.recv().await {
            Some(message) => {
                self.in_flight = self.in_flight.saturating_sub(1);
                message
            }
            // A sender is kept, so that the channel stays open.
            None => std::future::pending().await,
        }
    }
}

/// The renderer's answer as the protocol has it.
fn in_protocol(found: &api::Inspection) -> Inspection {
    let value = |value: &api::Value| match *value {
        api::Value::Number(number) => FieldValue::Number(number),
        api::Value::Count(count) => FieldValue::Count(count),
        api::Value::Triple(triple) => FieldValue::Triple(triple),
    };
    let field = |field: &api::Field| Field {
        id: field.id.into(),
        label: field.label.into(),
        unit: field.unit.into(),
        value: value(&field.value),
    };
    let column =
        |column: &api::Column| Column { id: column.id.into(), label: column.label.into(), unit: column.unit.into() };
    let row = |row: &api::Row| Row {
        values: row.values.iter().map(value).collect(),
        disc: row.disc.map(|disc| Disc { position: disc.position, normal: disc.normal, radius: disc.radius }),
    };
    Inspection {
        position: found.position,
        normal: found.normal,
        headline: found.headline.clone(),
        summary: found.summary.iter().map(field).collect(),
        columns: found.columns.iter().map(column).collect(),
        rows: found.rows.iter().map(row).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_lost_on_the_way_to_the_protocol() {
        let disc = api::Disc { position: [5.0, 6.0, 7.0], normal: [8.0, 9.0, 10.0], radius: 11.0 };
        let values = vec![api::Value::Count(1), api::Value::Number(2.5), api::Value::Triple([12.0, 13.0, 14.0])];
        let column = |id| api::Column { id, label: "A", unit: "m" };
        let found = api::Inspection {
            position: [1.0, 2.0, 3.0],
            normal: [4.0, 5.0, 6.0],
            headline: "One of them.".to_owned(),
            summary: vec![api::Field { id: "trust", label: "Trust", unit: "s", value: api::Value::Number(0.5) }],
            columns: vec![column("id"), column("share"), column("light")],
            rows: vec![api::Row { values, disc: Some(disc) }],
        };
        let theirs = serde_json::to_value(&found).expect("encodes");
        assert_eq!(serde_json::to_value(in_protocol(&found)).expect("encodes"), theirs);
    }
}
