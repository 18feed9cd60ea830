"""Final detections of networks that say each object once, and so need no suppression."""

from __future__ import annotations

from .interface import DensePredictions, Detections


def of_queries(found: DensePredictions, score_threshold: float, exclusive: bool, limit: int = 0) -> list[Detections]:
    """Final detections per image, best first; a score is objectness times class probability.

    Args:
        exclusive: a query speaks for its best class alone; otherwise for every class, and the best pairs of an image
            count.
        limit: most of these pairs; 0 for one per query.
    """
    scores = found.objectness[..., None] * found.classes
    if exclusive:
        best, labels = scores.max(-1)
        best, queries = best.sort(dim=1, descending=True, stable=True)
        labels = labels.gather(1, queries)
    else:
        best, pairs = scores.flatten(1).topk(min(limit or scores.shape[1], scores[0].numel()), 1)
        queries, labels = pairs // scores.shape[2], pairs % scores.shape[2]
    kept = best > score_threshold
    return [
        Detections(boxes[query[keep]], score[keep], label[keep])
        for boxes, query, score, label, keep in zip(found.boxes, queries, best, labels, kept, strict=True)
    ]
