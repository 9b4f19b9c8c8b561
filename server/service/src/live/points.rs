//! Questions about a point of the picture that the client sees: what is there, and what lights it.

use surfelcast_protocol::inspection::{Contribution, Inspection};
use surfelcast_protocol::server::ServerMessage;
use surfelcast_renderer::{RendererError, RendererHandle, SessionKey};

use crate::live::connection::{Connection, POINT_QUESTIONS};
use crate::live::inbound::{Refusal, check_view, invalid};
use crate::live::outbound::AckedView;
use crate::validate::within;

/// What is asked about a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PointQuestion {
    /// Which surface is there.
    Pick,
    /// Which surfels light it.
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

impl Connection {
    /// Asks the renderer; the answer follows when it has looked. Answers that wait are bounded.
    pub(crate) fn on_point(
        &mut self,
        question: PointQuestion,
        id: Option<u64>,
        view: u16,
        point: [f32; 2],
    ) -> Result<(), Refusal> {
        let name = question.name();
        check_view(view)?;
        within("x", point[0], 0.0, 1.0).map_err(invalid)?;
        within("y", point[1], 0.0, 1.0).map_err(invalid)?;
        let Some(view) = self.outbound.acked_view() else {
            let detail = format!("{name}: no frame was acknowledged yet, so there is no picture to point into");
            return Err(Refusal { code: "no_frame", detail });
        };
        if self.inbound.points_in_flight >= POINT_QUESTIONS {
            let detail = format!("{name}: {POINT_QUESTIONS} points are being looked at already; wait for an answer");
            return Err(Refusal { code: "busy", detail });
        }
        let Some(late) = self.inbound.late.clone() else { return Ok(()) };
        self.inbound.points_in_flight += 1;
        let handle = self.state.handle().clone();
        let session = self.member.live.key;
        drop(tokio::spawn(async move {
            let answer = question.ask(&handle, session, view, point, id).await;
            let message = answer.unwrap_or_else(|error| question.failed(id, &error.to_string()));
            // The connection may be gone by now.
            let _ = late.send(message).await;
        }));
        Ok(())
    }
}

/// The renderer's answer in the words of the protocol.
fn in_protocol(found: &surfelcast_renderer::Inspection) -> Inspection {
    let part = |part: &surfelcast_renderer::Contribution| Contribution {
        id: part.id,
        share: part.share,
        weight: part.weight,
        visibility: part.visibility,
        position: part.position,
        normal: part.normal,
        radius: part.radius,
        direct: part.direct,
        indirect: part.indirect,
        ray_count: part.ray_count,
        std_error: part.std_error,
    };
    Inspection {
        position: found.position,
        normal: found.normal,
        coverage: found.coverage,
        trust: found.trust,
        direct: found.direct,
        indirect: found.indirect,
        contributions: found.contributions.iter().map(part).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_lost_on_the_way_to_the_protocol() {
        let part = surfelcast_renderer::Contribution {
            id: 1,
            share: 2.0,
            weight: 3.0,
            visibility: 4.0,
            position: [5.0, 6.0, 7.0],
            normal: [8.0, 9.0, 10.0],
            radius: 11.0,
            direct: [12.0, 13.0, 14.0],
            indirect: [15.0, 16.0, 17.0],
            ray_count: 18.0,
            std_error: 19.0,
        };
        let found = surfelcast_renderer::Inspection {
            position: [1.0, 2.0, 3.0],
            normal: [4.0, 5.0, 6.0],
            coverage: 7.0,
            trust: 8.0,
            direct: [9.0, 10.0, 11.0],
            indirect: [12.0, 13.0, 14.0],
            contributions: vec![part],
        };
        let theirs = serde_json::to_value(&found).expect("encodes");
        assert_eq!(serde_json::to_value(in_protocol(&found)).expect("encodes"), theirs);
    }
}
