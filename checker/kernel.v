(* Proofs of lower bounds of polynomials, checked by computation with integers.

   A certificate is a tree. Its nodes shrink a box of the variables X by showing that a row is
   negative beyond an end, cut it in two, or bound the objective F by an identity in t,
   X = C + S t with |t| <= 1:

     k (F - B) = sum of w p^2 g + sum of q h + r,    r_0 >= sum of the sizes of r's other terms.

   [sound] says that what [check] accepts is true. *)

Require Import Reals ZArith List Lra Lia Bool FMapPositive.
Import ListNotations.
Module M := PositiveMap.
Open Scope R_scope.

(* ---- polynomials: lists of words and integer coefficients, words ascending ---- *)

Definition word := list positive.
Definition poly := list (word * Z).
Definition env := positive -> R.

Fixpoint mon (t : env) (w : word) : R :=
  match w with [] => 1 | v :: w' => t v * mon t w' end.

Fixpoint ev (t : env) (p : poly) : R :=
  match p with [] => 0 | (w, c) :: q => IZR c * mon t w + ev t q end.

Fixpoint wmul (a : word) : word -> word :=
  fix inner b :=
    match a, b with
    | [], _ => b
    | _, [] => a
    | x :: a', y :: b' => if Pos.leb x y then x :: wmul a' b else y :: inner b'
    end.

Lemma mon_cons t v w : mon t (v :: w) = t v * mon t w.
Proof. reflexivity. Qed.

Lemma ev_cons t w c p : ev t ((w, c) :: p) = IZR c * mon t w + ev t p.
Proof. reflexivity. Qed.

Lemma mon_wmul t a : forall b, mon t (wmul a b) = mon t a * mon t b.
Proof.
  induction a as [|x a IHa].
  - intros b; destruct b; simpl; ring.
  - induction b as [|y b IHb].
    + simpl; ring.
    + change (wmul (x :: a) (y :: b))
        with (if Pos.leb x y then x :: wmul a (y :: b) else y :: wmul (x :: a) b).
      destruct (Pos.leb x y).
      * rewrite mon_cons, IHa, !mon_cons. ring.
      * rewrite mon_cons, IHb, !mon_cons. ring.
Qed.

Fixpoint lex (a b : word) : comparison :=
  match a, b with
  | [], [] => Eq
  | [], _ => Lt
  | _, [] => Gt
  | x :: a', y :: b' => match Pos.compare x y with Eq => lex a' b' | c => c end
  end.

Definition wcmp (a b : word) : comparison :=
  match Nat.compare (length a) (length b) with Eq => lex a b | c => c end.

Lemma lex_eq a : forall b, lex a b = Eq -> a = b.
Proof.
  induction a as [|x a IH]; intros [|y b]; simpl; try discriminate; auto.
  destruct (Pos.compare x y) eqn:E; try discriminate.
  intros H. apply Pos.compare_eq in E. rewrite (IH b H), E. reflexivity.
Qed.

Lemma wcmp_eq a b : wcmp a b = Eq -> a = b.
Proof.
  unfold wcmp. destruct (Nat.compare _ _); try discriminate. apply lex_eq.
Qed.

Definition cons0 (w : word) (c : Z) (p : poly) : poly := if Z.eqb c 0 then p else (w, c) :: p.

Lemma ev_cons0 t w c p : ev t (cons0 w c p) = IZR c * mon t w + ev t p.
Proof.
  unfold cons0. destruct (Z.eqb_spec c 0) as [->|]; simpl; ring.
Qed.

Fixpoint padd (p : poly) : poly -> poly :=
  fix inner q :=
    match p, q with
    | [], _ => q
    | _, [] => p
    | (v, c) :: p', (w, d) :: q' =>
        match wcmp v w with
        | Eq => cons0 v (c + d) (padd p' q')
        | Lt => (v, c) :: padd p' q
        | Gt => (w, d) :: inner q'
        end
    end.

Lemma ev_padd t p : forall q, ev t (padd p q) = ev t p + ev t q.
Proof.
  induction p as [|[v c] p IHp].
  - intros q; destruct q; simpl; ring.
  - induction q as [|[w d] q IHq].
    + simpl; ring.
    + change (padd ((v, c) :: p) ((w, d) :: q))
        with (match wcmp v w with
              | Eq => cons0 v (c + d) (padd p q)
              | Lt => (v, c) :: padd p ((w, d) :: q)
              | Gt => (w, d) :: padd ((v, c) :: p) q
              end).
      destruct (wcmp v w) eqn:E.
      * apply wcmp_eq in E. subst w. rewrite ev_cons0, IHp, plus_IZR, !ev_cons. ring.
      * rewrite ev_cons, IHp, !ev_cons. ring.
      * rewrite ev_cons, IHq, !ev_cons. ring.
Qed.

Fixpoint pmono (w : word) (c : Z) (p : poly) : poly :=
  match p with [] => [] | (v, d) :: q => (wmul w v, (c * d)%Z) :: pmono w c q end.

Lemma ev_pmono t w c p : ev t (pmono w c p) = IZR c * mon t w * ev t p.
Proof.
  induction p as [|[v d] p IH]; simpl; [ring|].
  rewrite IH, mon_wmul, mult_IZR. ring.
Qed.

Fixpoint pmul (p q : poly) : poly :=
  match p with [] => [] | (w, c) :: p' => padd (pmono w c q) (pmul p' q) end.

Lemma ev_pmul t p q : ev t (pmul p q) = ev t p * ev t q.
Proof.
  induction p as [|[w c] p IH]; simpl; [ring|].
  rewrite ev_padd, ev_pmono, IH. ring.
Qed.

Definition pconst (c : Z) : poly := cons0 [] c [].

Lemma ev_pconst t c : ev t (pconst c) = IZR c.
Proof. unfold pconst. rewrite ev_cons0. simpl; ring. Qed.

Arguments pconst _ : simpl never.
Arguments padd _ _ : simpl never.
Arguments pmul _ _ : simpl never.
Arguments pmono _ _ _ : simpl never.

Fixpoint ppow (p : poly) (n : nat) : poly :=
  match n with O => pconst 1 | S m => pmul p (ppow p m) end.

Lemma ev_ppow t p n : ev t (ppow p n) = ev t p ^ n.
Proof.
  induction n as [|n IH]; cbn [ppow pow].
  - apply ev_pconst.
  - rewrite ev_pmul, IH. reflexivity.
Qed.

(* X = C + S t *)
Definition affine := M.t (Z * Z).

Definition linear (a b : Z) (v : positive) : poly := cons0 [] b (cons0 [v] a []).

Arguments linear _ _ _ : simpl never.

Lemma ev_linear t a b v : ev t (linear a b v) = IZR a * t v + IZR b.
Proof. unfold linear. rewrite !ev_cons0. simpl; ring. Qed.

Fixpoint wsubst (cs : affine) (w : word) : poly :=
  match w with
  | [] => pconst 1
  | v :: w' =>
      match M.find v cs with
      | Some (c, s) => pmul (linear s c v) (wsubst cs w')
      | None => pmul (linear 1 0 v) (wsubst cs w')
      end
  end.

Fixpoint psubst (cs : affine) (p : poly) : poly :=
  match p with [] => [] | (w, c) :: q => padd (pmono [] c (wsubst cs w)) (psubst cs q) end.

Definition image (cs : affine) (t : env) : env :=
  fun v => match M.find v cs with Some (c, s) => IZR s * t v + IZR c | None => t v end.

Lemma ev_wsubst cs t w : ev t (wsubst cs w) = mon (image cs t) w.
Proof.
  induction w as [|v w IH]; cbn [wsubst mon].
  - apply ev_pconst.
  - unfold image at 1. destruct (M.find v cs) as [[c s]|];
      rewrite ev_pmul, IH, ev_linear; ring.
Qed.

Lemma ev_psubst cs t p : ev t (psubst cs p) = ev (image cs t) p.
Proof.
  induction p as [|[w c] p IH]; cbn [psubst ev]; [reflexivity|].
  rewrite ev_padd, ev_pmono, IH, ev_wsubst. cbn [mon]; ring.
Qed.

Lemma mon_ext t u w : (forall v, t v = u v) -> mon t w = mon u w.
Proof. intros H. induction w as [|v w IH]; simpl; [reflexivity|]. now rewrite IH, H. Qed.

Lemma ev_ext t u p : (forall v, t v = u v) -> ev t p = ev u p.
Proof.
  intros H. induction p as [|[w c] p IH]; simpl; [reflexivity|]. now rewrite IH, (mon_ext t u w H).
Qed.

(* ---- intervals with integer ends; None is infinite ---- *)

Definition ivl := (option Z * option Z)%type.
Definition above (x : R) (a : option Z) : Prop := match a with Some c => IZR c <= x | None => True end.
Definition below (x : R) (b : option Z) : Prop := match b with Some c => x <= IZR c | None => True end.
Definition mem (x : R) (i : ivl) : Prop := above x (fst i) /\ below x (snd i).

Definition iadd (i j : ivl) : ivl :=
  (match fst i, fst j with Some a, Some c => Some (a + c)%Z | _, _ => None end,
   match snd i, snd j with Some b, Some d => Some (b + d)%Z | _, _ => None end).

Lemma mem_iadd x y i j : mem x i -> mem y j -> mem (x + y) (iadd i j).
Proof.
  destruct i as [[a|] [b|]], j as [[c|] [d|]]; unfold mem, iadd, above, below; simpl;
    intros [? ?] [? ?]; split; auto; rewrite ?plus_IZR; lra.
Qed.

Definition iscale (k b : Z) (i : ivl) : ivl :=
  let move e := match e with Some a => Some (k * a + b)%Z | None => None end in
  if Z.leb 0 k then (move (fst i), move (snd i)) else (move (snd i), move (fst i)).

Lemma mem_iscale x k b i : mem x i -> mem (IZR k * x + IZR b) (iscale k b i).
Proof.
  unfold iscale. destruct (Z.leb_spec 0 k) as [H|H];
    [apply IZR_le in H | apply IZR_lt in H];
    destruct i as [[lo|] [hi|]]; unfold mem, above, below; simpl; intros [? ?]; split; auto;
    rewrite plus_IZR, mult_IZR; nra.
Qed.

Definition min4 a b c d := Z.min (Z.min a b) (Z.min c d).
Definition max4 a b c d := Z.max (Z.max a b) (Z.max c d).

Definition imul (i j : ivl) : ivl :=
  match i, j with
  | (Some a, Some b), (Some c, Some d) =>
      (Some (min4 (a * c) (a * d) (b * c) (b * d))%Z, Some (max4 (a * c) (a * d) (b * c) (b * d))%Z)
  | (Some a, b), (Some c, d) =>
      if Z.leb 0 a && Z.leb 0 c
      then (Some (a * c)%Z, match b, d with Some b', Some d' => Some (b' * d')%Z | _, _ => None end)
      else (None, None)
  | _, _ => (None, None)
  end.

Lemma product_above x y a b c d m :
  a <= x <= b -> c <= y <= d -> m <= a * c -> m <= a * d -> m <= b * c -> m <= b * d -> m <= x * y.
Proof.
  intros. destruct (Rle_dec 0 y).
  - assert (a * y <= x * y) by nra. destruct (Rle_dec 0 a); nra.
  - assert (b * y <= x * y) by nra. destruct (Rle_dec 0 b); nra.
Qed.

Lemma min4_le a b c d :
  (min4 a b c d <= a /\ min4 a b c d <= b /\ min4 a b c d <= c /\ min4 a b c d <= d)%Z.
Proof. unfold min4. lia. Qed.

Lemma max4_ge a b c d :
  (a <= max4 a b c d /\ b <= max4 a b c d /\ c <= max4 a b c d /\ d <= max4 a b c d)%Z.
Proof. unfold max4. lia. Qed.

Lemma imul_finite x y a b c d :
  IZR a <= x <= IZR b -> IZR c <= y <= IZR d ->
  IZR (min4 (a * c) (a * d) (b * c) (b * d)) <= x * y
  <= IZR (max4 (a * c) (a * d) (b * c) (b * d)).
Proof.
  intros Hx Hy.
  destruct (min4_le (a * c) (a * d) (b * c) (b * d)) as (L1 & L2 & L3 & L4).
  destruct (max4_ge (a * c) (a * d) (b * c) (b * d)) as (U1 & U2 & U3 & U4).
  apply IZR_le in L1, L2, L3, L4, U1, U2, U3, U4.
  rewrite mult_IZR in L1, L2, L3, L4, U1, U2, U3, U4. split.
  - eapply product_above with (a := IZR a) (c := IZR c); eauto.
  - assert (H : - IZR (max4 (a * c) (a * d) (b * c) (b * d)) <= (- x) * y).
    { eapply product_above with (a := - IZR b) (b := - IZR a) (c := IZR c) (d := IZR d); lra. }
    lra.
Qed.

Lemma mem_imul x y i j : mem x i -> mem y j -> mem (x * y) (imul i j).
Proof.
  destruct i as [[a|] [b|]], j as [[c|] [d|]]; unfold imul;
    try (intros; split; exact I);
    try (destruct (Z.leb_spec 0 a) as [Ha|Ha]; destruct (Z.leb_spec 0 c) as [Hc|Hc]; simpl;
         try (intros; split; exact I);
         apply IZR_le in Ha, Hc;
         unfold mem, above, below; simpl; intros [? ?] [? ?]; split; auto;
         rewrite mult_IZR; nra).
  unfold mem, above, below; simpl. intros. apply imul_finite; tauto.
Qed.

Definition iabs (i : ivl) : ivl :=
  match i with
  | (Some a, b) => if Z.leb 0 a then (Some a, b) else
      match b with Some c => (Some 0%Z, Some (Z.max (- a) c)) | None => (Some 0%Z, None) end
  | (None, Some b) => if Z.leb b 0 then (Some (- b)%Z, None) else (Some 0%Z, None)
  | (None, None) => (Some 0%Z, None)
  end.

(* for both signs: where b <= 0, minus x is meant *)
Definition ineg (i : ivl) : ivl := iscale (-1) 0 i.

Definition isize (i : ivl) : ivl :=
  match snd i with
  | Some b => if Z.leb b 0 then ineg i else iabs i
  | None => iabs i
  end.

Lemma mem_iabs x i : mem x i -> mem (Rabs x) (iabs i).
Proof.
  pose proof (Rabs_pos x) as P.
  destruct i as [[a|] [b|]]; unfold iabs, mem, above, below; simpl; intros [H1 H2].
  - destruct (Z.leb_spec 0 a) as [Ha|Ha]; simpl.
    + apply IZR_le in Ha. rewrite Rabs_right by lra. auto.
    + split; auto. unfold Rabs. destruct (Rcase_abs x).
      * assert (IZR (- a) <= IZR (Z.max (- a) b)) by (apply IZR_le; lia).
        rewrite opp_IZR in *. lra.
      * assert (IZR b <= IZR (Z.max (- a) b)) by (apply IZR_le; lia). lra.
  - destruct (Z.leb_spec 0 a) as [Ha|Ha]; simpl; auto.
    apply IZR_le in Ha. rewrite Rabs_right by lra. auto.
  - destruct (Z.leb_spec b 0) as [Hb|Hb]; simpl; split; auto.
    apply IZR_le in Hb. rewrite opp_IZR. rewrite Rabs_left1 by lra. lra.
  - auto.
Qed.

Lemma mem_isize x i : mem x i -> mem (Rabs x) (isize i).
Proof.
  unfold isize. intros H. destruct i as [a [b|]]; cbn [snd]; [|exact (mem_iabs x (a, None) H)].
  destruct (Z.leb_spec b 0) as [Hb|Hb]; [|exact (mem_iabs x (a, Some b) H)].
  assert (E : Rabs x = IZR (-1) * x + IZR 0).
  { destruct H as [_ H]. simpl in H. apply IZR_le in Hb. rewrite Rabs_left1 by lra. lra. }
  rewrite E. now apply mem_iscale.
Qed.

Fixpoint ipow (i : ivl) (n : nat) : ivl :=
  match n with O => (Some 1%Z, Some 1%Z) | S O => i | S m => imul i (ipow i m) end.

Lemma mem_ipow x i n : mem x i -> mem (x ^ n) (ipow i n).
Proof.
  intros H. induction n as [|n IH].
  - simpl. unfold mem, above, below; simpl; lra.
  - destruct n as [|n].
    + simpl. rewrite Rmult_1_r. exact H.
    + change (ipow i (S (S n))) with (imul i (ipow i (S n))).
      change (x ^ S (S n)) with (x * x ^ S n). now apply mem_imul.
Qed.

Definition ipower (i : ivl) (n : nat) : ivl := if Nat.even n then ipow (isize i) n else ipow i n.

Lemma even_power x n : Nat.even n = true -> Rabs x ^ n = x ^ n.
Proof.
  intros H. apply Nat.even_spec in H. destruct H as [m ->].
  rewrite !pow_mult. f_equal. simpl. rewrite !Rmult_1_r.
  unfold Rabs. destruct (Rcase_abs x); ring.
Qed.

Lemma mem_ipower x i n : mem x i -> mem (x ^ n) (ipower i n).
Proof.
  unfold ipower. intros H. destruct (Nat.even n) eqn:E.
  - rewrite <- (even_power x n E). now apply mem_ipow, mem_isize.
  - now apply mem_ipow.
Qed.

(* ---- rows as sums of products of powers of a X_v + b, over a box ---- *)

Definition factor := (Z * Z * positive * nat)%type.
Definition form := list (Z * list factor).
Definition box := M.t ivl.

Definition inside (X : env) (b : box) : Prop := forall v i, M.find v b = Some i -> mem (X v) i.

Fixpoint fev (X : env) (fs : list factor) : R :=
  match fs with [] => 1 | (a, b, v, n) :: gs => (IZR a * X v + IZR b) ^ n * fev X gs end.

Fixpoint eval (X : env) (e : form) : R :=
  match e with [] => 0 | (c, fs) :: e' => IZR c * fev X fs + eval X e' end.

Fixpoint fexpand (fs : list factor) : poly :=
  match fs with [] => pconst 1 | (a, b, v, n) :: gs => pmul (ppow (linear a b v) n) (fexpand gs) end.

Fixpoint expand (e : form) : poly :=
  match e with [] => [] | (c, fs) :: e' => padd (pmono [] c (fexpand fs)) (expand e') end.

Lemma ev_fexpand X fs : ev X (fexpand fs) = fev X fs.
Proof.
  induction fs as [|[[[a b] v] n] fs IH]; cbn [fexpand fev]; [apply ev_pconst|].
  now rewrite ev_pmul, ev_ppow, ev_linear, IH.
Qed.

Lemma ev_expand X e : ev X (expand e) = eval X e.
Proof.
  induction e as [|[c fs] e IH]; cbn [expand eval]; [reflexivity|].
  rewrite ev_padd, ev_pmono, ev_fexpand, IH. cbn [mon]; ring.
Qed.

Definition whole : ivl := (None, None).
Definition at_ (b : box) (v : positive) : ivl := match M.find v b with Some i => i | None => whole end.

Lemma mem_at X b v : inside X b -> mem (X v) (at_ b v).
Proof.
  intros H. unfold at_. destruct (M.find v b) as [i|] eqn:E; [now apply H|]. split; exact I.
Qed.

Fixpoint frange (b : box) (fs : list factor) : ivl :=
  match fs with
  | [] => (Some 1%Z, Some 1%Z)
  | (a, k, v, n) :: [] => ipower (iscale a k (at_ b v)) n
  | (a, k, v, n) :: gs => imul (ipower (iscale a k (at_ b v)) n) (frange b gs)
  end.

Fixpoint range (b : box) (e : form) : ivl :=
  match e with
  | [] => (Some 0%Z, Some 0%Z)
  | (c, fs) :: e' => iadd (iscale c 0 (frange b fs)) (range b e')
  end.

Lemma mem_frange X b fs : inside X b -> mem (fev X fs) (frange b fs).
Proof.
  intros H. induction fs as [|[[[a k] v] n] fs IH].
  - simpl. unfold mem, above, below; simpl; lra.
  - destruct fs as [|f fs].
    + simpl. rewrite Rmult_1_r. now apply mem_ipower, mem_iscale, mem_at.
    + change (mem ((IZR a * X v + IZR k) ^ n * fev X (f :: fs))
        (imul (ipower (iscale a k (at_ b v)) n) (frange b (f :: fs)))).
      apply mem_imul; [now apply mem_ipower, mem_iscale, mem_at | exact IH].
Qed.

Lemma mem_range X b e : inside X b -> mem (eval X e) (range b e).
Proof.
  intros H. induction e as [|[c fs] e IH]; simpl.
  - unfold mem, above, below; simpl; lra.
  - apply mem_iadd; [|exact IH].
    replace (IZR c * fev X fs) with (IZR c * fev X fs + IZR 0) by ring.
    now apply mem_iscale, mem_frange.
Qed.

Lemma inside_empty X : inside X (M.empty ivl).
Proof. intros v i. rewrite M.gempty. discriminate. Qed.

(* ---- rows: a polynomial that is zero (true) or not negative (false) ---- *)

Definition row := (poly * bool)%type.
Definition holds (X : env) (r : row) : Prop :=
  if snd r then ev X (fst r) = 0 else 0 <= ev X (fst r).
Definition all_hold (X : env) (rs : list row) : Prop := forall r, In r rs -> holds X r.

Definition peq (p q : poly) : bool := match padd p (pmono [] (-1) q) with [] => true | _ => false end.

Lemma peq_ev X p q : peq p q = true -> ev X p = ev X q.
Proof.
  unfold peq. intros H. assert (E := ev_padd X p (pmono [] (-1) q)).
  destruct (padd p (pmono [] (-1) q)); [|discriminate].
  rewrite ev_pmono in E. simpl in E. lra.
Qed.

Definition never (equal : bool) (i : ivl) : bool :=
  match snd i with Some b => Z.ltb b 0 | None => false end
  || (equal && match fst i with Some a => Z.ltb 0 a | None => false end).

Lemma never_sound equal x i :
  mem x i -> never equal i = true -> (if equal then x = 0 else 0 <= x) -> False.
Proof.
  unfold never. intros [L U] H E. apply orb_true_iff in H. destruct H as [H|H].
  - destruct (snd i) as [b|]; [|discriminate]. apply Z.ltb_lt, IZR_lt in H. simpl in U.
    destruct equal; lra.
  - apply andb_true_iff in H. destruct H as [H1 H2]. rewrite H1 in E.
    destruct (fst i) as [a|]; [|discriminate]. apply Z.ltb_lt, IZR_lt in H2. simpl in L. lra.
Qed.

(* row number, multiple k > 0, its form, variable, whether the upper end falls, the new end *)
Record shave := { srow : nat; smul : Z; sform : form; svar : positive; supper : bool; send : Z }.

Definition upper_end (i : ivl) (e : Z) : ivl :=
  (fst i, Some (match snd i with Some b => Z.min b e | None => e end)).
Definition lower_end (i : ivl) (e : Z) : ivl :=
  (Some (match fst i with Some a => Z.max a e | None => e end), snd i).

Lemma mem_upper x i e : mem x i -> x <= IZR e -> mem x (upper_end i e).
Proof.
  intros [L U] H. split; [exact L|]. unfold upper_end; simpl. destruct (snd i) as [b|]; auto.
  simpl in *. destruct (Z.min_spec b e) as [[_ ->]|[_ ->]]; auto.
Qed.

Lemma mem_lower x i e : mem x i -> IZR e <= x -> mem x (lower_end i e).
Proof.
  intros [L U] H. split; [|exact U]. unfold lower_end; simpl. destruct (fst i) as [a|]; auto.
  simpl in *. destruct (Z.max_spec a e) as [[_ ->]|[_ ->]]; auto.
Qed.

Lemma inside_add X b v i : inside X b -> mem (X v) i -> inside X (M.add v i b).
Proof.
  intros H Hv u j. destruct (Pos.eq_dec u v) as [->|N].
  - rewrite M.gss. intros E. injection E as <-. exact Hv.
  - rewrite M.gso by congruence. apply H.
Qed.

Definition shaved (rs : list row) (b : box) (s : shave) : option box :=
  match nth_error rs (srow s) with
  | None => None
  | Some (p, equal) =>
      let i := at_ b (svar s) in
      let far := if supper s then lower_end i (send s) else upper_end i (send s) in
      let left := if supper s then upper_end i (send s) else lower_end i (send s) in
      if Z.ltb 0 (smul s) && peq (expand (sform s)) (pmono [] (smul s) p)
         && never equal (range (M.add (svar s) far b) (sform s))
      then Some (M.add (svar s) left b) else None
  end.

Lemma shaved_sound X rs b s b' :
  all_hold X rs -> inside X b -> shaved rs b s = Some b' -> inside X b'.
Proof.
  unfold shaved. intros Hr Hb. destruct (nth_error rs (srow s)) as [[p equal]|] eqn:N;
    [|discriminate].
  destruct (_ && _ && _) eqn:C; [|discriminate]. intros E. injection E as <-.
  apply andb_true_iff in C. destruct C as [C C3]. apply andb_true_iff in C. destruct C as [C1 C2].
  apply Z.ltb_lt, IZR_lt in C1. apply (peq_ev X) in C2. rewrite ev_expand, ev_pmono in C2.
  apply nth_error_In in N. assert (H := Hr _ N). unfold holds in H; simpl in H.
  simpl in C2. set (i := at_ b (svar s)) in *.
  assert (Hi : mem (X (svar s)) i) by now apply mem_at.
  assert (V : if equal then eval X (sform s) = 0 else 0 <= eval X (sform s)).
  { destruct equal; rewrite C2; nra. }
  apply inside_add; [exact Hb|].
  destruct (supper s).
  - apply mem_upper; [exact Hi|]. destruct (Rle_dec (X (svar s)) (IZR (send s))) as [|Far]; auto.
    exfalso. eapply never_sound; [|exact C3|exact V]. apply mem_range, inside_add; auto.
    apply mem_lower; auto. lra.
  - apply mem_lower; [exact Hi|]. destruct (Rle_dec (IZR (send s)) (X (svar s))) as [|Far]; auto.
    exfalso. eapply never_sound; [|exact C3|exact V]. apply mem_range, inside_add; auto.
    apply mem_upper; auto. lra.
Qed.

Fixpoint shave_all (rs : list row) (b : box) (ss : list shave) : option box :=
  match ss with
  | [] => Some b
  | s :: ss' => match shaved rs b s with Some b' => shave_all rs b' ss' | None => None end
  end.

Lemma shave_all_sound X rs ss : all_hold X rs ->
  forall b b', inside X b -> shave_all rs b ss = Some b' -> inside X b'.
Proof.
  intros Hr. induction ss as [|s ss IH]; simpl; intros b b' Hb E.
  - injection E as <-. exact Hb.
  - destruct (shaved rs b s) as [c|] eqn:F; [|discriminate].
    eapply IH; [|exact E]. eapply shaved_sound; eauto.
Qed.

(* ---- identities ---- *)

Inductive gen :=
| One | Row (k : nat) | Both (v : positive) | Low (v : positive) | High (v : positive)
| Times (g h : gen).

Fixpoint gpoly (rs : list row) (cs : affine) (g : gen) : poly :=
  match g with
  | One => pconst 1
  | Row k => match nth_error rs k with Some (p, _) => psubst cs p | None => [] end
  | Both v => pmul (linear (-1) 1 v) (linear 1 1 v)
  | Low v => linear 1 1 v
  | High v => linear (-1) 1 v
  | Times g h => pmul (gpoly rs cs g) (gpoly rs cs h)
  end.

Definition unit_box (t : env) : Prop := forall v, -1 <= t v <= 1.

Lemma gpoly_pos rs cs g t :
  unit_box t -> all_hold (image cs t) rs -> 0 <= ev t (gpoly rs cs g).
Proof.
  intros U H. induction g as [|k|v|v|v|g IHg h IHh]; cbn [gpoly].
  - rewrite ev_pconst. lra.
  - destruct (nth_error rs k) as [[p e]|] eqn:N; [|cbn [ev]; lra].
    rewrite ev_psubst. apply nth_error_In in N. assert (F := H _ N). unfold holds in F; simpl in F.
    destruct e; lra.
  - rewrite ev_pmul, !ev_linear. specialize (U v). nra.
  - rewrite ev_linear. specialize (U v). lra.
  - rewrite ev_linear. specialize (U v). lra.
  - rewrite ev_pmul. now apply Rmult_le_pos.
Qed.

Inductive mult :=
| Square (w : Z) (p : poly) (g : gen)      (* w p^2 g with w >= 0 *)
| Free (p : poly) (k : nat).               (* p times an equation *)

Definition mpoly (rs : list row) (cs : affine) (m : mult) : option poly :=
  match m with
  | Square w p g => if Z.leb 0 w then Some (pmono [] w (pmul (pmul p p) (gpoly rs cs g))) else None
  | Free p k => match nth_error rs k with
                | Some (q, true) => Some (pmul p (psubst cs q))
                | _ => None
                end
  end.

Fixpoint msum (rs : list row) (cs : affine) (ms : list mult) : option poly :=
  match ms with
  | [] => Some []
  | m :: ms' => match mpoly rs cs m, msum rs cs ms' with
                | Some p, Some q => Some (padd p q)
                | _, _ => None
                end
  end.

Lemma msum_pos rs cs ms t : unit_box t -> all_hold (image cs t) rs ->
  forall p, msum rs cs ms = Some p -> 0 <= ev t p.
Proof.
  intros U H. induction ms as [|m ms IH]; simpl; intros p E.
  - injection E as <-. simpl; lra.
  - destruct (mpoly rs cs m) as [q|] eqn:F; [|discriminate].
    destruct (msum rs cs ms) as [r|]; [|discriminate]. injection E as <-.
    rewrite ev_padd. assert (0 <= ev t r) by (now apply IH).
    assert (0 <= ev t q); [|lra]. destruct m as [w s g|s k]; simpl in F.
    + destruct (Z.leb_spec 0 w) as [W|]; [|discriminate]. injection F as <-.
      apply IZR_le in W. rewrite ev_pmono, !ev_pmul. simpl.
      assert (0 <= ev t (gpoly rs cs g)) by now apply gpoly_pos.
      assert (0 <= ev t s * ev t s) by nra. rewrite Rmult_1_r.
      apply Rmult_le_pos; [exact W | apply Rmult_le_pos; assumption].
    + destruct (nth_error rs k) as [[q' [|]]|] eqn:N; try discriminate. injection F as <-.
      rewrite ev_pmul, ev_psubst. apply nth_error_In in N. assert (Z0 := H _ N).
      unfold holds in Z0; simpl in Z0. rewrite Z0. lra.
Qed.

(* all powers even, so that the monomial is not negative *)
Fixpoint even_word (w : word) : bool :=
  match w with [] => true | x :: y :: w' => Pos.eqb x y && even_word w' | _ => false end.

Definition cost (w : word) (c : Z) : Z := if even_word w then Z.max 0 (- c) else Z.abs c.

(* the constant term less what the others cost *)
Fixpoint margin (p : poly) : Z :=
  match p with [] => 0 | ([], c) :: q => (c + margin q)%Z | (w, c) :: q => (margin q - cost w c)%Z end.

Lemma even_word_pos t : forall n w, (length w <= n)%nat -> even_word w = true -> 0 <= mon t w.
Proof.
  induction n as [|n IH]; intros [|x [|y w]] L E; simpl in *; try lia; try discriminate; try lra.
  apply andb_true_iff in E. destruct E as [E1 E2]. apply Pos.eqb_eq in E1. subst y.
  rewrite <- Rmult_assoc. apply Rmult_le_pos; [apply Rle_0_sqr|]. apply IH; auto. lia.
Qed.

Lemma mon_unit t w : unit_box t -> -1 <= mon t w <= 1.
Proof.
  intros U. induction w as [|v w IH]; simpl; [lra|]. specialize (U v).
  assert (0 <= (1 - t v) * (1 + mon t w)) by (apply Rmult_le_pos; lra).
  assert (0 <= (1 + t v) * (1 - mon t w)) by (apply Rmult_le_pos; lra).
  assert (0 <= (1 - t v) * (1 - mon t w)) by (apply Rmult_le_pos; lra).
  assert (0 <= (1 + t v) * (1 + mon t w)) by (apply Rmult_le_pos; lra).
  split; lra.
Qed.

Lemma cost_sound t w c : unit_box t -> - IZR (cost w c) <= IZR c * mon t w.
Proof.
  intros U. assert (M := mon_unit t w U). unfold cost. destruct (even_word w) eqn:E.
  - assert (P := even_word_pos t (length w) w (le_n _) E).
    assert (A : 0 <= IZR (Z.max 0 (- c))) by (apply IZR_le; lia).
    assert (B : - IZR c <= IZR (Z.max 0 (- c))) by (rewrite <- opp_IZR; apply IZR_le; lia).
    assert (0 <= (IZR (Z.max 0 (- c)) + IZR c) * mon t w) by (apply Rmult_le_pos; lra).
    assert (IZR (Z.max 0 (- c)) * mon t w <= IZR (Z.max 0 (- c)) * 1)
      by (apply Rmult_le_compat_l; lra).
    lra.
  - rewrite abs_IZR. assert (A := Rle_abs (IZR c)). assert (B := Rle_abs (- IZR c)).
    rewrite Rabs_Ropp in B. nra.
Qed.

Lemma margin_sound t p : unit_box t -> IZR (margin p) <= ev t p.
Proof.
  intros U. induction p as [|[[|v w] c] p IH]; [simpl; lra| |].
  - simpl. rewrite plus_IZR. lra.
  - change (margin ((v :: w, c) :: p)) with (margin p - cost (v :: w) c)%Z.
    rewrite ev_cons, minus_IZR. assert (C := cost_sound t (v :: w) c U). lra.
Qed.

Record identity := { icentre : list (positive * (Z * Z)); ifactor : Z; imults : list mult }.

Definition of_list (l : list (positive * (Z * Z))) : affine :=
  fold_right (fun e m => M.add (fst e) (snd e) m) (M.empty _) l.

(* every variable of the list lies in C +- S *)
Definition covered (b : box) (e : positive * (Z * Z)) : bool :=
  let '(v, (c, s)) := e in
  Z.leb 0 s
  && match at_ b v with
     | (Some lo, Some hi) => Z.leb (c - s) lo && Z.leb hi (c + s)
     | _ => false
     end.

Definition t_of (cs : affine) (X : env) : env :=
  fun v => match M.find v cs with
           | Some (c, s) => if Z.eqb s 0 then 0 else (X v - IZR c) / IZR s
           | None => 0
           end.

Definition in_list (p : poly) (cs : affine) : bool :=
  forallb (fun m => forallb (fun v => M.mem v cs) (fst m)) p.

Definition clipped (cs : affine) (X : env) : env := image cs (t_of cs X).

Lemma of_list_find l v c s : M.find v (of_list l) = Some (c, s) -> In (v, (c, s)) l.
Proof.
  induction l as [|[u e] l IH]; simpl.
  - rewrite M.gempty. discriminate.
  - destruct (Pos.eq_dec v u) as [->|N].
    + rewrite M.gss. intros E. injection E as ->. now left.
    + rewrite M.gso by congruence. intros E. right. now apply IH.
Qed.

Lemma t_of_unit l b X : inside X b -> forallb (covered b) l = true -> unit_box (t_of (of_list l) X).
Proof.
  intros Hb Hc v. unfold t_of. destruct (M.find v (of_list l)) as [[c s]|] eqn:F; [|lra].
  apply of_list_find in F. rewrite forallb_forall in Hc. apply Hc in F. unfold covered in F.
  apply andb_true_iff in F. destruct F as [F1 F2]. apply Z.leb_le in F1.
  destruct (at_ b v) as [[lo|] [hi|]] eqn:A; try discriminate.
  apply andb_true_iff in F2. destruct F2 as [L U]. apply Z.leb_le, IZR_le in L, U.
  rewrite minus_IZR in L. rewrite plus_IZR in U.
  assert (V := mem_at X b v Hb). rewrite A in V. destruct V as [V1 V2]. simpl in V1, V2.
  destruct (Z.eqb_spec s 0) as [|N]; [lra|].
  assert (P : 0 < IZR s) by (apply IZR_lt; lia).
  split; [apply Rmult_le_reg_r with (IZR s) | apply Rmult_le_reg_r with (IZR s)]; auto;
    unfold Rdiv; rewrite Rmult_assoc, Rinv_l by lra; lra.
Qed.

Lemma image_t_of l b X v : inside X b -> forallb (covered b) l = true ->
  M.mem v (of_list l) = true -> image (of_list l) (t_of (of_list l) X) v = X v.
Proof.
  intros Hb Hc Hm. unfold image, t_of. rewrite M.mem_find in Hm.
  destruct (M.find v (of_list l)) as [[c s]|] eqn:F; [|discriminate].
  apply of_list_find in F. rewrite forallb_forall in Hc. apply Hc in F. unfold covered in F.
  apply andb_true_iff in F. destruct F as [F1 F2]. apply Z.leb_le in F1.
  destruct (at_ b v) as [[lo|] [hi|]] eqn:A; try discriminate.
  apply andb_true_iff in F2. destruct F2 as [L U]. apply Z.leb_le, IZR_le in L, U.
  rewrite minus_IZR in L. rewrite plus_IZR in U.
  assert (V := mem_at X b v Hb). rewrite A in V. destruct V as [V1 V2]. simpl in V1, V2.
  destruct (Z.eqb_spec s 0) as [->|N]; [simpl in L, U |- *; lra|].
  assert (P : 0 < IZR s) by (apply IZR_lt; lia). field. lra.
Qed.

Lemma ev_in_list X Y cs p : in_list p cs = true ->
  (forall v, M.mem v cs = true -> X v = Y v) -> ev X p = ev Y p.
Proof.
  intros H E. induction p as [|[w c] p IH]; simpl; [reflexivity|].
  simpl in H. apply andb_true_iff in H. destruct H as [H1 H2]. rewrite (IH H2). f_equal. f_equal.
  clear - H1 E. induction w as [|v w IH]; simpl; [reflexivity|].
  simpl in H1. apply andb_true_iff in H1. destruct H1 as [H1 H2]. now rewrite (E v H1), (IH H2).
Qed.

Definition rows_in (rs : list row) (cs : affine) : bool := forallb (fun r => in_list (fst r) cs) rs.

Definition bounds (rs : list row) (F : poly) (B : Z) (b : box) (i : identity) : bool :=
  let cs := of_list (icentre i) in
  forallb (covered b) (icentre i) && rows_in rs cs && in_list F cs
  && match msum rs cs (imults i) with
     | None => false
     | Some p =>
         let k := ifactor i in
         let left := pmono [] k (padd (psubst cs F) (pconst (- B))) in
         let rest := margin (padd left (pmono [] (-1) p)) in
         if Z.eqb k 0 then Z.ltb 0 rest else Z.ltb 0 k && Z.leb 0 rest
     end.

Lemma bounds_sound rs F B b i X : inside X b -> all_hold X rs -> bounds rs F B b i = true ->
  IZR B <= ev X F.
Proof.
  unfold bounds. intros Hb Hr H. repeat (apply andb_true_iff in H; destruct H as [H ?]).
  set (cs := of_list (icentre i)) in *.
  assert (U : unit_box (t_of cs X)) by (eapply t_of_unit; eauto).
  assert (S : forall v, M.mem v cs = true -> image cs (t_of cs X) v = X v)
    by (intros v Hv; eapply image_t_of; eauto).
  assert (Hr' : all_hold (image cs (t_of cs X)) rs).
  { intros r Hin. unfold rows_in in H2. rewrite forallb_forall in H2. specialize (H2 r Hin).
    specialize (Hr r Hin). unfold holds in *.
    rewrite (ev_in_list (image cs (t_of cs X)) X cs (fst r) H2 S). exact Hr. }
  destruct (msum rs cs (imults i)) as [p|] eqn:P; [|discriminate].
  assert (Pos := msum_pos rs cs (imults i) (t_of cs X) U Hr' p P).
  set (q := padd (pmono [] (ifactor i) (padd (psubst cs F) (pconst (- B)))) (pmono [] (-1) p)) in *.
  assert (Mg := margin_sound (t_of cs X) q U).
  assert (Q : ev (t_of cs X) q = IZR (ifactor i) * (ev X F - IZR B) - ev (t_of cs X) p).
  { unfold q. rewrite ev_padd, !ev_pmono, ev_padd, ev_pconst, ev_psubst, opp_IZR.
    rewrite (ev_in_list (image cs (t_of cs X)) X cs F H1 S). simpl. ring. }
  destruct (Z.eqb_spec (ifactor i) 0) as [E|N].
  - apply Z.ltb_lt, IZR_lt in H0. rewrite E in Q. simpl in Q. lra.
  - apply andb_true_iff in H0. destruct H0 as [K L].
    apply Z.ltb_lt, IZR_lt in K. apply Z.leb_le, IZR_le in L.
    assert (0 <= IZR (ifactor i) * (ev X F - IZR B)) by lra. nra.
Qed.

(* ---- trees ---- *)

Inductive tree :=
| Leaf (ss : list shave) (i : identity)
| Plain (ss : list shave) (f : form) (k : Z)    (* the range of F is enough *)
| Void (ss : list shave) (v : positive)
| Branch (ss : list shave) (v : positive) (at_v : Z) (low high : tree).

Definition plain (F : poly) (B : Z) (b : box) (f : form) (k : Z) : bool :=
  Z.ltb 0 k && peq (expand f) (pmono [] k F)
  && match fst (range b f) with Some a => Z.leb (k * B) a | None => false end.

Lemma plain_sound F B b f k X : inside X b -> plain F B b f k = true -> IZR B <= ev X F.
Proof.
  unfold plain. intros Hb H. apply andb_true_iff in H. destruct H as [H H3].
  apply andb_true_iff in H. destruct H as [H1 H2].
  apply Z.ltb_lt, IZR_lt in H1. apply (peq_ev X) in H2. rewrite ev_expand, ev_pmono in H2.
  assert (R := mem_range X b f Hb). destruct R as [R _].
  destruct (fst (range b f)) as [a|]; [|discriminate]. apply Z.leb_le, IZR_le in H3.
  rewrite mult_IZR in H3. simpl in R, H2. nra.
Qed.

Fixpoint check (rs : list row) (F : poly) (B : Z) (b : box) (t : tree) : bool :=
  match t with
  | Leaf ss i => match shave_all rs b ss with Some c => bounds rs F B c i | None => false end
  | Plain ss f k => match shave_all rs b ss with Some c => plain F B c f k | None => false end
  | Void ss v => match shave_all rs b ss with
                 | Some c => match at_ c v with (Some lo, Some hi) => Z.ltb hi lo | _ => false end
                 | None => false
                 end
  | Branch ss v e low high =>
      match shave_all rs b ss with
      | Some c => check rs F B (M.add v (upper_end (at_ c v) e) c) low
                  && check rs F B (M.add v (lower_end (at_ c v) e) c) high
      | None => false
      end
  end.

Theorem check_sound rs F B t X : all_hold X rs ->
  forall b, inside X b -> check rs F B b t = true -> IZR B <= ev X F.
Proof.
  intros Hr. induction t as [ss i|ss f k|ss v|ss v e low IHl high IHh]; simpl; intros b Hb H;
    destruct (shave_all rs b ss) as [c|] eqn:S; try discriminate;
    assert (Hc : inside X c) by (eapply shave_all_sound; eauto).
  - eapply bounds_sound; eauto.
  - eapply plain_sound; eauto.
  - assert (V := mem_at X c v Hc). destruct (at_ c v) as [[lo|] [hi|]]; try discriminate.
    destruct V as [L U]. simpl in L, U. apply Z.ltb_lt, IZR_lt in H. lra.
  - apply andb_true_iff in H. destruct H as [H1 H2].
    assert (V := mem_at X c v Hc). destruct (Rle_dec (X v) (IZR e)) as [|N].
    + eapply IHl; [|exact H1]. apply inside_add; auto. now apply mem_upper.
    + eapply IHh; [|exact H2]. apply inside_add; auto. apply mem_lower; auto. lra.
Qed.

(* with a cutoff W: where F > W there is nothing to show *)
Theorem sound rs F B W b t X : all_hold X rs -> inside X b -> Z.leb B W = true ->
  check (rs ++ [(padd (pconst W) (pmono [] (-1) F), false)]) F B b t = true -> IZR B <= ev X F.
Proof.
  intros Hr Hb HW H. apply Z.leb_le, IZR_le in HW.
  destruct (Rle_dec (ev X F) (IZR W)) as [L|]; [|lra].
  eapply check_sound; [|exact Hb|exact H].
  intros r Hin. apply in_app_or in Hin. destruct Hin as [Hin|[<-|[]]]; [now apply Hr|].
  unfold holds; simpl. rewrite ev_padd, ev_pconst, ev_pmono. simpl. lra.
Qed.
