import pytest

from pipelines.stages import Stages


def test_a_finished_stage_is_skipped_and_an_unfinished_one_entered_again(tmp_path):
    entered = []
    product = tmp_path / "product"

    def fails():
        entered.append("fails")
        raise KeyboardInterrupt

    def works():
        entered.append("works")
        product.write_text("made")

    with pytest.raises(KeyboardInterrupt):
        Stages(tmp_path).run("a", [1], fails, product)
    assert Stages(tmp_path).seconds() == {}
    Stages(tmp_path).run("a", (1,), works, product)
    Stages(tmp_path).run("a", (1,), works, product)  # a list in the file
    assert entered == ["fails", "works"]
    assert set(Stages(tmp_path).seconds()) == {"a"}


def test_other_arguments_or_a_lost_product_make_it_again(tmp_path):
    entered = []
    product = tmp_path / "product"

    def works():
        entered.append(1)
        product.write_text("made")

    Stages(tmp_path).run("a", [1], works, product)
    Stages(tmp_path).run("a", [2], works, product)
    product.unlink()
    Stages(tmp_path).run("a", [2], works, product)
    assert len(entered) == 3


def test_a_damaged_memory_is_forgotten(tmp_path):
    (tmp_path / "stages.json").write_text("{half")
    assert Stages(tmp_path).seconds() == {}
