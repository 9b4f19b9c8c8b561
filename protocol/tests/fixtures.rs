//! The golden messages and frames decode, encode back to the same bytes, and nothing a stranger sends makes a panic.

use proptest::prelude::*;
use serde_json::Value;
use surfelcast_protocol::client::{ClientEnvelope, ClientMessage};
use surfelcast_protocol::frame::{FrameError, FrameHeader, HEADER_BYTES, flags};
use surfelcast_protocol::parse::{CLIENT_TYPES, ParseError, parse_client};
use surfelcast_protocol::server::ServerMessage;
use surfelcast_protocol::settings::Codec;

const CLIENT: &str = include_str!("../fixtures/client_messages.json");
const SERVER: &str = include_str!("../fixtures/server_messages.json");
const FRAMES: [(&[u8], &str); 3] = [
    (include_bytes!("../fixtures/frame_jpeg_moving.bin"), include_str!("../fixtures/frame_jpeg_moving.json")),
    (include_bytes!("../fixtures/frame_webp_final.bin"), include_str!("../fixtures/frame_webp_final.json")),
    (include_bytes!("../fixtures/frame_png_still.bin"), include_str!("../fixtures/frame_png_still.json")),
];

/// Writes every number as a double, so that `1` and `1.0` compare equal as they do in a browser.
fn plain(value: Value) -> Value {
    match value {
        Value::Number(n) => serde_json::json!(n.as_f64()),
        Value::Array(items) => items.into_iter().map(plain).collect(),
        Value::Object(fields) => fields.into_iter().map(|(k, v)| (k, plain(v))).collect(),
        other => other,
    }
}

fn items(text: &str) -> Vec<Value> {
    serde_json::from_str::<Vec<Value>>(text).expect("fixture is a JSON array")
}

fn kinds(list: &[Value]) -> Vec<String> {
    let mut kinds: Vec<String> = list.iter().filter_map(|v| v["t"].as_str().map(str::to_owned)).collect();
    kinds.sort();
    kinds.dedup();
    kinds
}

#[test]
fn client_messages_decode_and_encode_back() {
    let list = items(CLIENT);
    for item in &list {
        let decoded: ClientEnvelope = serde_json::from_value(item.clone()).expect("fixture decodes");
        let encoded = serde_json::to_string(&decoded).expect("encodes");
        assert_eq!(plain(serde_json::from_str(&encoded).expect("is JSON")), plain(item.clone()));
        assert_eq!(parse_client(&item.to_string()).as_ref(), Ok(&decoded));
    }
    let mut expected: Vec<String> = CLIENT_TYPES.iter().map(ToString::to_string).collect();
    expected.sort();
    assert_eq!(kinds(&list), expected, "every type has a fixture");
}

#[test]
fn server_messages_decode_and_encode_back() {
    let list = items(SERVER);
    for item in &list {
        let decoded: ServerMessage = serde_json::from_value(item.clone()).expect("fixture decodes");
        let encoded = serde_json::to_string(&decoded).expect("encodes");
        assert_eq!(plain(serde_json::from_str(&encoded).expect("is JSON")), plain(item.clone()));
    }
    let all = ["error", "inspected", "lights", "notice", "ok", "picked", "ping", "pong", "stats", "welcome"];
    assert_eq!(kinds(&list), all, "every type has a fixture");
}

#[test]
fn an_absent_output_is_not_a_null_one() {
    let aov = |text: &str| match parse_client(text).map(|envelope| envelope.message) {
        Ok(ClientMessage::ViewSet(set)) => set.aov,
        other => panic!("{other:?}"),
    };
    assert_eq!(aov(r#"{"t":"view.set"}"#), None);
    assert_eq!(aov(r#"{"t":"view.set","aov":null}"#), Some(None));
    assert_eq!(aov(r#"{"t":"view.set","aov":"normal"}"#), Some(Some("normal".into())));
}

#[test]
fn frames_decode_and_encode_back() {
    for (bytes, expected) in FRAMES {
        let expected: Value = serde_json::from_str(expected).expect("fixture is JSON");
        let header = FrameHeader::decode(bytes).expect("fixture decodes");
        assert_eq!(header.encode()[..], bytes[..HEADER_BYTES]);
        let number = |field: &str| expected[field].as_u64().expect("a number");
        assert_eq!(serde_json::to_value(header.codec).expect("encodes"), expected["codec"]);
        assert_eq!(u64::from(header.flags), number("flags"));
        assert_eq!(u64::from(header.view), number("view"));
        assert_eq!(u64::from(header.frame_seq), number("frame_seq"));
        assert_eq!(u64::from(header.input_seq), number("input_seq"));
        assert_eq!(u64::from(header.scene_rev), number("scene_rev"));
        assert_eq!(serde_json::json!(header.rect), expected["rect"]);
        assert_eq!(serde_json::json!(header.full_size), expected["full_size"]);
        assert_eq!(u64::from(header.server_us), number("server_us"));
        assert_eq!(u64::from(header.render_10us), number("render_10us"));
        assert_eq!(u64::from(header.encode_10us), number("encode_10us"));
        assert_eq!(u64::from(header.spp), number("spp"));
        assert_eq!(u64::from(header.quality), number("quality"));
        assert_eq!(u64::from(header.payload_len), number("payload_len"));
        assert_eq!(bytes.len() - HEADER_BYTES, header.payload_len as usize);
    }
}

#[test]
fn broken_frames_are_refused_by_field() {
    let good = FRAMES[0].0;
    assert_eq!(FrameHeader::decode(&good[..40]), Err(FrameError::Short(40)));
    for (at, field) in [(0, "magic"), (1, "version"), (2, "kind"), (3, "codec")] {
        let mut bad = good.to_vec();
        bad[at] = 99;
        assert!(matches!(FrameHeader::decode(&bad), Err(FrameError::Field { field: f, .. }) if f == field));
    }
    assert!(matches!(FrameHeader::decode(&good[..good.len() - 1]), Err(FrameError::Length { .. })));
}

#[test]
fn strangers_get_three_kinds_of_answers() {
    let malformed = |text: &str| matches!(parse_client(text), Err(ParseError::Malformed(_)));
    assert!(
        malformed("") && malformed("[]") && malformed("{}") && malformed("{\"t\":1}") && malformed("{\"t\":\"ping\"")
    );
    assert!(malformed(&"[".repeat(100_000)), "deep nesting is refused, not recursed into");
    let unsupported = ParseError::Unsupported { id: Some(3), kind: "dance".into() };
    assert_eq!(parse_client("{\"t\":\"dance\",\"id\":3,\"x\":1}"), Err(unsupported));
    match parse_client("{\"t\":\"pick\",\"id\":9,\"x\":0.5}") {
        Err(ParseError::Invalid { id: Some(9), kind, detail }) => {
            assert_eq!(kind, "pick");
            assert!(detail.contains('y'), "{detail}");
        }
        other => panic!("{other:?}"),
    }
    let newer = r#"{"t":"hello","v":[1],"caps":{"codecs":["avif","png"]}}"#;
    match parse_client(newer).map(|envelope| envelope.message) {
        Ok(ClientMessage::Hello(hello)) => assert_eq!(hello.caps.codecs, [Codec::Png], "unknown codecs are skipped"),
        other => panic!("{other:?}"),
    }
    match parse_client(r#"{"t":"view.set","id":4,"aov":7}"#) {
        Err(ParseError::Invalid { id: Some(4), detail, .. }) => assert!(detail.starts_with("aov: "), "{detail}"),
        other => panic!("{other:?}"),
    }
    let extra = "{\"t\":\"ping\",\"ts\":1.5,\"new_field\":[1,2]}";
    assert!(parse_client(extra).is_ok(), "unknown fields are ignored");
}

proptest! {
    #[test]
    fn decoding_any_bytes_never_panics(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = FrameHeader::decode(&bytes);
    }

    #[test]
    fn mutated_frames_never_panic(which in 0..3usize, at in 0..100usize, to in any::<u8>()) {
        let mut bytes = FRAMES[which].0.to_vec();
        let len = bytes.len();
        bytes[at % len] = to;
        let _ = FrameHeader::decode(&bytes);
    }

    #[test]
    fn headers_survive_the_round_trip(
        (codec, flag_bits, view) in (0..3usize, any::<u16>(), any::<u16>()),
        words in any::<[u32; 4]>(),
        halves in any::<[u16; 9]>(),
        quality in any::<u8>(),
        payload in prop::collection::vec(any::<u8>(), 0..40),
    ) {
        let header = FrameHeader {
            codec: [Codec::Jpeg, Codec::Webp, Codec::Png][codec],
            flags: flag_bits | flags::KEYFRAME,
            view,
            frame_seq: words[0],
            input_seq: words[1],
            scene_rev: words[2],
            rect: [halves[0], halves[1], halves[2], halves[3]],
            full_size: [halves[4], halves[5]],
            server_us: words[3],
            render_10us: halves[6],
            encode_10us: halves[7],
            spp: halves[8],
            quality,
            payload_len: payload.len() as u32,
        };
        let mut message = header.encode().to_vec();
        message.extend(&payload);
        prop_assert_eq!(FrameHeader::decode(&message), Ok(header));
    }

    #[test]
    fn parsing_any_text_never_panics(text in ".{0,200}") {
        let _ = parse_client(&text);
    }

    #[test]
    fn parsing_mutated_messages_never_panics(which in 0..32usize, at in any::<prop::sample::Index>(), to in any::<char>()) {
        let list = items(CLIENT);
        let mut text: Vec<char> = list[which % list.len()].to_string().chars().collect();
        let at = at.index(text.len());
        text[at] = to;
        let _ = parse_client(&text.into_iter().collect::<String>());
    }
}
