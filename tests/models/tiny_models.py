"""Tiny models with random weights, saved as a user's checkpoint folder would be.

The code that runs is the real one of transformers; only the numbers in it mean nothing.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import torch
import transformers as tf
from safetensors.torch import load_file, save_file

SIDE = 64  # of the square input of every tiny SAM


def _sam_parts(prefix: str, **decoder):
    vision = getattr(tf, f"{prefix}VisionConfig")(
        hidden_size=16, output_channels=16, num_hidden_layers=2, num_attention_heads=2,
        image_size=SIDE, patch_size=8, window_size=4, global_attn_indexes=[1], num_pos_feats=8,
    )  # fmt: skip
    prompt = getattr(tf, f"{prefix}PromptEncoderConfig")(
        hidden_size=16, image_size=SIDE, patch_size=8, mask_input_channels=4
    )
    mask = getattr(tf, f"{prefix}MaskDecoderConfig")(
        hidden_size=16, mlp_dim=16, num_attention_heads=2, iou_head_hidden_dim=16, **decoder
    )
    return {"vision_config": vision, "prompt_encoder_config": prompt, "mask_decoder_config": mask}


def _save(model, folder: Path, processor: dict) -> Path:
    # Weights of the default size make logits of 1e-10, whose sign is all noise.
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.normal_(0.0, 0.3)
    model.save_pretrained(folder)
    (folder / "preprocessor_config.json").write_text(json.dumps(processor))
    return folder


def save_sam(folder: Path) -> Path:
    torch.manual_seed(1)
    processor = {"image_mean": [0.5, 0.4, 0.3], "image_std": [0.2, 0.3, 0.4]}
    return _save(tf.SamModel(tf.SamConfig(**_sam_parts("Sam"))), folder, processor)


def save_sam_hq(folder: Path) -> Path:
    torch.manual_seed(2)
    config = tf.SamHQConfig(**_sam_parts("SamHQ", vit_dim=16))
    return _save(tf.SamHQModel(config), folder, {})


def _sam2_parts():
    hiera = tf.Sam2HieraDetConfig(
        hidden_size=8, num_attention_heads=1, image_size=[SIDE, SIDE],
        blocks_per_stage=[1, 1, 2, 1],
        embed_dim_per_stage=[8, 16, 32, 64], num_attention_heads_per_stage=[1, 1, 2, 2],
        window_size_per_stage=[4, 4, 4, 4], global_attention_blocks=[3],
    )  # fmt: skip
    vision = tf.Sam2VisionConfig(
        backbone_config=hiera, backbone_channel_list=[64, 32, 16, 8], fpn_hidden_size=32,
        backbone_feature_sizes=[[16, 16], [8, 8], [4, 4]],
    )  # fmt: skip
    prompt = {"hidden_size": 32, "image_size": SIDE, "patch_size": 16, "mask_input_channels": 4}
    mask = {"hidden_size": 32, "mlp_dim": 16, "num_attention_heads": 2, "iou_head_hidden_dim": 16}
    return vision, prompt, mask


def save_sam2(folder: Path) -> Path:
    torch.manual_seed(3)
    vision, prompt, mask = _sam2_parts()
    config = tf.Sam2Config(
        vision_config=vision,
        prompt_encoder_config=tf.Sam2PromptEncoderConfig(**prompt),
        mask_decoder_config=tf.Sam2MaskDecoderConfig(**mask),
    )
    return _save(tf.Sam2Model(config), folder, {})


def save_sam2_video(folder: Path) -> Path:
    """The layout of the published SAM 2 checkpoints: the video model's."""
    torch.manual_seed(4)
    vision, prompt, mask = _sam2_parts()
    config = tf.Sam2VideoConfig(
        vision_config=vision,
        prompt_encoder_config=tf.Sam2VideoPromptEncoderConfig(**prompt),
        mask_decoder_config=tf.Sam2VideoMaskDecoderConfig(**mask),
        image_size=SIDE,
        memory_attention_hidden_size=32,
        memory_attention_num_layers=1,
        memory_attention_feed_forward_hidden_size=16,
        memory_encoder_hidden_size=32,
        memory_encoder_output_channels=8,
        mask_downsampler_embed_dim=32,
        memory_fuser_embed_dim=32,
        memory_fuser_intermediate_dim=16,
        memory_fuser_num_layers=1,
    )
    return _save(tf.Sam2VideoModel(config), folder, {})


def _bert_vocabulary(folder: Path) -> int:
    words = [
        "[PAD]",
        "[UNK]",
        "[CLS]",
        "[SEP]",
        "[MASK]",
        ".",
        "?",
        "robot",
        "arm",
        "grip",
        "##per",
    ]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "vocab.txt").write_text("\n".join(words) + "\n")
    tokenizer = tf.BertTokenizer(vocab=str(folder / "vocab.txt"))
    tokenizer.save_pretrained(folder)
    return len(words)


def save_grounding_dino(folder: Path) -> Path:
    torch.manual_seed(5)
    n_words = _bert_vocabulary(folder)
    backbone = tf.SwinConfig(
        image_size=64, patch_size=4, embed_dim=8, depths=[1, 1, 1, 1], num_heads=[1, 1, 2, 2],
        window_size=4, out_indices=[2, 3, 4],
    )  # fmt: skip
    text = tf.BertConfig(
        vocab_size=n_words, hidden_size=16, num_hidden_layers=1, num_attention_heads=2,
        intermediate_size=16, max_position_embeddings=64,
    )  # fmt: skip
    config = tf.GroundingDinoConfig(
        backbone_config=backbone, text_config=text, num_queries=12, d_model=32, encoder_layers=1,
        encoder_ffn_dim=16, encoder_attention_heads=2, decoder_layers=2, decoder_ffn_dim=16,
        decoder_attention_heads=2, max_text_len=16,
    )  # fmt: skip
    model = tf.GroundingDinoForObjectDetection(config)
    return _save(model, folder, {})


def _clip_vocabulary(folder: Path) -> int:
    letters = [chr(c) for c in range(ord("a"), ord("z") + 1)]
    words = [*letters, *(f"{c}</w>" for c in letters), "<|startoftext|>", "<|endoftext|>"]
    tokenizer = tf.CLIPTokenizer(vocab={w: i for i, w in enumerate(words)}, merges=[])
    folder.mkdir(parents=True, exist_ok=True)
    tokenizer.save_pretrained(folder)
    return len(words)


def _sam3_parts(n_words: int):
    vit = tf.Sam3ViTConfig(
        hidden_size=32, intermediate_size=32, num_hidden_layers=2, num_attention_heads=2,
        image_size=SIDE, patch_size=8, window_size=4, global_attn_indexes=[1],
        pretrain_image_size=32,
    )  # fmt: skip
    vision = tf.Sam3VisionConfig(
        backbone_config=vit, fpn_hidden_size=32, backbone_feature_sizes=[[32, 32], [16, 16], [8, 8]]
    )
    small = {"hidden_size": 32, "num_attention_heads": 2, "intermediate_size": 32, "num_layers": 1}
    detector = tf.Sam3Config(
        vision_config=vision,
        text_config={
            "model_type": "clip_text_model", "vocab_size": n_words, "hidden_size": 16,
            "intermediate_size": 16,
            "projection_dim": 16, "num_hidden_layers": 1, "num_attention_heads": 2,
            "max_position_embeddings": 32, "eos_token_id": n_words - 1,
            "bos_token_id": n_words - 2,
        },
        geometry_encoder_config=dict(small),
        detr_encoder_config=dict(small),
        detr_decoder_config=dict(small, num_queries=6),
        mask_decoder_config={"hidden_size": 32, "num_attention_heads": 2},
    )  # fmt: skip
    tracker = tf.Sam3TrackerConfig(
        vision_config=vision,
        prompt_encoder_config={
            "hidden_size": 32,
            "image_size": SIDE,
            "patch_size": 8,
            "mask_input_channels": 4,
        },
        mask_decoder_config={
            "hidden_size": 32,
            "mlp_dim": 16,
            "num_attention_heads": 2,
            "iou_head_hidden_dim": 16,
        },
    )
    return detector, tracker


def save_sam3(folder: Path) -> Path:
    torch.manual_seed(6)
    detector, _ = _sam3_parts(_clip_vocabulary(folder))
    return _save(tf.Sam3Model(detector), folder, {})


def save_sam3_tracker(folder: Path) -> Path:
    torch.manual_seed(7)
    _, tracker = _sam3_parts(54)
    return _save(tf.Sam3TrackerModel(tracker), folder, {})


def save_sam3_video(folder: Path) -> Path:
    """The layout of the published SAM 3 checkpoint: detector and tracker in one video model."""
    torch.manual_seed(8)
    detector, tracker = _sam3_parts(_clip_vocabulary(folder))
    parts = tracker.to_dict()
    tracker_video = tf.Sam3TrackerVideoConfig(
        vision_config=parts["vision_config"],
        prompt_encoder_config={
            "hidden_size": 32,
            "image_size": SIDE,
            "patch_size": 8,
            "mask_input_channels": 4,
        },
        mask_decoder_config={
            "hidden_size": 32,
            "mlp_dim": 16,
            "num_attention_heads": 2,
            "iou_head_hidden_dim": 16,
        },
        image_size=SIDE,
        memory_attention_hidden_size=32,
        memory_attention_num_layers=1,
        memory_attention_feed_forward_hidden_size=16,
        memory_encoder_hidden_size=32,
        memory_encoder_output_channels=8,
        mask_downsampler_embed_dim=32,
        memory_fuser_embed_dim=32,
        memory_fuser_intermediate_dim=16,
        memory_fuser_num_layers=1,
    )
    config = tf.Sam3VideoConfig(detector_config=detector, tracker_config=tracker_video)
    _save(tf.Sam3VideoModel(config), folder, {})
    # transformers 5.23 saves the tracker under a doubled prefix; the published file has one.
    file = folder / "model.safetensors"
    tensors = {
        name.replace("tracker_model.tracker_model.", "tracker_model."): tensor
        for name, tensor in load_file(file).items()
    }
    save_file(tensors, file, metadata={"format": "pt"})
    return folder


def in_half(source: Path, folder: Path, dtype: torch.dtype) -> Path:
    """A copy of a checkpoint with its weights in half precision, as fine-tuned ones are saved."""
    shutil.copytree(source, folder)
    file = folder / "model.safetensors"
    tensors = {name: tensor.to(dtype) for name, tensor in load_file(file).items()}
    save_file(tensors, file, metadata={"format": "pt"})
    config = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps(config | {"dtype": str(dtype)[6:]}))
    return folder


def without(source: Path, folder: Path, *prefixes: str) -> Path:
    """A copy of a checkpoint that lacks the tensors whose names begin so."""
    shutil.copytree(source, folder)
    file = folder / "model.safetensors"
    kept = {n: tensor for n, tensor in load_file(file).items() if not n.startswith(prefixes)}
    save_file(kept, file, metadata={"format": "pt"})
    return folder
